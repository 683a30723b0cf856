"""Edges and ridges: the filters on patterns drawn by hand, the kernel against NumPy, histograms, files."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from tests.oracles import edges as oracle
from workbench.body.kinematics import forward
from workbench.core.frame import View
from workbench.likelihoods.cues.edge_filters import (
    ALONG,
    POINTS,
    RIDGE_SCALES_PX,
    SmoothedBox,
    SmoothedView,
    filtered,
    responses,
    smoothed,
)
from workbench.likelihoods.cues.edges import BINS, EdgeModel, Edges, learn_edge_model, response_log_ratio
from workbench.likelihoods.cues.limb_points import bounding_box, limb_points
from workbench.motion.models.store import Provenance, load, save
from workbench.utils.errors import InputError

ROD = scenes.rods(((0.0, 0.0, -0.4), (0.0, 0.0, 0.4), 0.1))  # 15 px wide, from column 152 to 167
PROVENANCE = Provenance({}, {}, ())


def bar(level=180, roll=0.0):
    """The rod's silhouette, brighter than the rest; a pixel on its rim has its share of both."""
    x = np.arange(scenes.WIDTH) - (scenes.WIDTH - 1) / 2
    y = np.arange(scenes.HEIGHT)[:, None] - (scenes.HEIGHT - 1) / 2
    across = x * np.cos(roll) - y * np.sin(roll)
    return np.rint(100 + (level - 100) * np.clip(8.0 - np.abs(across), 0.0, 1.0)).astype(np.uint8)


def frame_likelihood(image, pose):
    points = limb_points(ROD, POINTS, scenes.FRONT, forward(ROD.skeleton, pose))
    return responses(filtered(smoothed(View(scenes.FRONT, image))), points)


def test_a_step_answers_where_and_along_which_direction_it_lies():
    on, on_axis, counts = frame_likelihood(bar(), scenes.root())
    assert counts.all()
    aside, _, _ = frame_likelihood(bar(), scenes.root((0.0, 0.6, 0.0)))
    across, _, _ = frame_likelihood(bar(), scenes.root(roll=np.pi / 2))
    assert on.min() > 0.3
    assert aside.max() < 1e-6
    assert across[0, 0, [0, -1]].max() < 1e-6  # the ends of a rod that lies across the bar meet no edge
    # the step of 80 levels over its local contrast; half of it within the central difference of the blurred image
    assert np.ptp(on) < 0.05
    assert on_axis.shape == (1, 1, ALONG)


def test_a_bar_is_a_ridge_along_its_axis_only():
    _, along, _ = frame_likelihood(bar(), scenes.root())
    _, across, _ = frame_likelihood(bar(), scenes.root(roll=np.pi / 2))
    middle = ALONG // 2
    assert along.min() > 0.3
    assert across[0, 0, [middle - 1, middle]].max() < 0.0  # there, what changes lies along the limb
    assert RIDGE_SCALES_PX[1] == 4.0  # the scale for half a width of 7.5 px


@pytest.mark.parametrize("roll", [0.3, -0.8])
def test_filters_are_steered(roll):
    upright, tilted = frame_likelihood(bar(), scenes.root()), frame_likelihood(bar(roll=roll), scenes.root(roll=roll))
    wrong = frame_likelihood(bar(roll=roll), scenes.root(roll=-roll))
    # the square window of the contrast holds more of a tilted bar, and the rim is drawn to a pixel
    np.testing.assert_allclose(tilted[1].mean(), upright[1].mean(), rtol=0.1)
    np.testing.assert_allclose(tilted[0].mean(), upright[0].mean(), rtol=0.1)
    assert wrong[0].mean() < 0.5 * tilted[0].mean()


def test_contrast_does_not_matter():
    faint, strong = frame_likelihood(bar(level=140), scenes.root()), frame_likelihood(bar(level=220), scenes.root())
    # the floor of 4 grey levels under a contrast of 20 and of 60
    np.testing.assert_allclose(strong[0] / faint[0], (1.0 + 4.0 / 20.0) / (1.0 + 4.0 / 60.0), rtol=0.05)


def test_kernel_agrees_with_plain_numpy():
    rng = np.random.default_rng(0)
    table = rng.standard_normal((2, len(scenes.PERSON.limbs), BINS)).astype(np.float32)
    poses = scenes.people(rng, 60)
    poses[0, 0] = 5.0  # behind the camera
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    images = filtered(smoothed(View(scenes.FRONT, scenes.texture(rng))))
    expected, found = (f(images, points, table) for f in (oracle.response_log_ratio, response_log_ratio))
    assert expected.std() > 0.05
    assert not found[0].any()
    # a response may fall on the edge of a bin and, in float32, on its other side: rarely, and that moves one of n terms
    agree = np.abs(found - expected) < 1e-6
    assert agree.mean() > 0.99
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2 * np.ptp(table) / len(POINTS))


@pytest.mark.parametrize("corner", [(0, 0), (150, 90), (270, 190)])
def test_a_part_is_smoothed_as_the_whole(corner):
    """Also where its view was looked at elsewhere before, and at the image's border."""
    view = View(scenes.FRONT, scenes.texture(np.random.default_rng(2)))
    whole, part, twice = smoothed(view), SmoothedView(view), SmoothedView(view)
    box = (*corner, corner[0] + 45, corner[1] + 45)
    twice.smoothed_around((120, 100, 160, 110))
    assert part.smoothed_around(box).levels.shape[1] < scenes.HEIGHT
    expected = filtered(whole, box)
    for each in (part, twice):
        found = filtered(each.smoothed_around(box), box)
        np.testing.assert_array_equal(found.gradient, expected.gradient)
        np.testing.assert_array_equal(found.ridges, expected.ridges)
    assert part.smoothed_around(box) is part.smoothed_around((*corner, corner[0] + 20, corner[1] + 30))


def test_learned_ratios_prefer_limbs_and_the_file_gives_them_back(tmp_path):
    """Bars of random contrast are learned; then the true place of a bar beats all places aside."""
    rng = np.random.default_rng(1)
    seen = [(ROD, View(scenes.FRONT, bar(int(level))), scenes.root()[0]) for level in rng.integers(120, 250, 8)]
    model = learn_edge_model(seen, rng)
    assert model.on.sum(axis=-1).tolist() == [[8 * 2 * ALONG], [8 * ALONG]]  # at both sides, on the axis
    save(tmp_path / "edges.h5", model, PROVENANCE)
    kept = load(EdgeModel, tmp_path / "edges.h5")
    np.testing.assert_array_equal(kept.log_ratio(["rod_0"]), model.log_ratio(["rod_0"]))

    likelihood = Edges(ROD, effective_responses=2.0)
    likelihood.__dict__["log_ratio"] = kept.log_ratio(ROD.limbs.names)  # instead of that of rendered people
    places = np.repeat(scenes.root(), 9, axis=0)
    places[:, 1] = np.linspace(-0.4, 0.4, 9)
    frame = scenes.frame(0, (scenes.FRONT, bar()))
    found = scenes.log_prob(likelihood, frame, frame, places, places)
    assert np.argmax(found) == 4
    assert found[4] > np.delete(found, 4).max() + 1.0


def test_bins_never_met_say_nothing():
    on, off = np.zeros((2, 1, BINS)), np.zeros((2, 1, BINS))
    on[:, 0, 3], off[:, 0, 5] = 10.0, 80.0
    found = EdgeModel(("rod",), on, off).log_ratio(["left_rod"])[0, 0]
    assert found[3] > 1.0
    assert found[5] < -1.0
    np.testing.assert_allclose(np.delete(found, [3, 5]), 0.0, atol=1e-6)


def test_neck_and_feet_say_nothing_and_that_is_told(caplog):
    on, off = np.zeros((2, 1, BINS)), np.zeros((2, 1, BINS))
    on[:, 0, 3], off[:, 0, 5] = 10.0, 80.0
    model = EdgeModel(("calf",), on, off)
    found = model.log_ratio(["neck", "left_calf", "left_foot"])
    assert np.array_equal(found[:, 1:2], model.log_ratio(["right_calf"]))
    assert not found[:, [0, 2]].any()
    assert caplog.messages == ["edges: the model has no foot and neck; their edges are ignored"]


def test_limbs_that_were_not_learned_are_an_error():
    model = EdgeModel(("thigh",), np.ones((2, 1, BINS)), np.ones((2, 1, BINS)))
    with pytest.raises(InputError, match="no limb 'tail' in the model; expected thigh"):
        model.log_ratio(["left_thigh", "tail"])
    with pytest.raises(InputError, match="effective_responses must be positive"):
        Edges(ROD, effective_responses=0.0)


@pytest.mark.parametrize("size", [(90, 70), (3, 2), (1, 5)])
def test_derivatives_are_those_of_opencv_to_the_bit_in_any_box(size):
    rng = np.random.default_rng(2)
    height, width = size
    levels = rng.uniform(0.0, 255.0, (1 + len(RIDGE_SCALES_PX), height, width)).astype(np.float32)
    images = SmoothedBox(levels, rng.uniform(4.0, 50.0, size).astype(np.float32), (0, 0, width, height))
    expected, found = oracle.filtered(images), filtered(images)
    np.testing.assert_array_equal(found.gradient, expected.gradient)
    np.testing.assert_array_equal(found.ridges, expected.ridges)
    left, top, right, bottom = width // 3, height // 4, width, height - height // 5
    part = filtered(images, (left, top, right, bottom))
    assert part.corner == (left, top)
    np.testing.assert_array_equal(part.gradient, expected.gradient[top:bottom, left:right])
    np.testing.assert_array_equal(part.ridges, expected.ridges[:, top:bottom, left:right])


def test_only_what_is_looked_up_is_filtered():
    """The same sums from the box about the points as from the whole image, and an empty box where nothing is seen."""
    rng = np.random.default_rng(3)
    images, poses = smoothed(View(scenes.FRONT, scenes.texture(rng))), scenes.people(rng, 40)
    table = rng.standard_normal((2, len(scenes.PERSON.limbs), BINS)).astype(np.float32)
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    left, top, right, bottom = bounding_box(points)
    seen = points.pixels[points.valid]
    assert (left, top) == tuple(np.floor(seen.min(axis=0)))
    assert (right, bottom) == tuple(np.floor(seen.max(axis=0)) + 2)
    within, whole = filtered(images, (left, top, right, bottom)), filtered(images)
    np.testing.assert_array_equal(*(response_log_ratio(each, points, table) for each in (within, whole)))
    poses[:, 0] = 5.0  # behind the camera
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    assert not response_log_ratio(filtered(images, bounding_box(points)), points, table).any()
