"""Edges and ridges: filter responses to a bar, the kernel against NumPy, and the learned model."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from tests.oracles import edges as oracle
from workbench.body.kinematics import forward
from workbench.core.frame import View
from workbench.likelihoods.cues import edges
from workbench.likelihoods.cues.edge_filters import (
    ALONG,
    POINTS,
    RIDGE_SCALES_PX,
    SmoothedBox,
    SmoothedView,
    _joint_box,
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


def bar_image(level=180, roll=0.0):
    """Draw the silhouette of the rod, rotated by `roll`, rad, with an anti-aliased outline."""
    x = np.arange(scenes.WIDTH) - (scenes.WIDTH - 1) / 2
    y = np.arange(scenes.HEIGHT)[:, None] - (scenes.HEIGHT - 1) / 2
    across = x * np.cos(roll) - y * np.sin(roll)
    return np.rint(100 + (level - 100) * np.clip(8.0 - np.abs(across), 0.0, 1.0)).astype(np.uint8)


def responses_to(image, pose):
    points = limb_points(ROD, POINTS, scenes.FRONT, forward(ROD.skeleton, pose))
    return responses(filtered(smoothed(View(scenes.FRONT, image))), points)


def test_edge_responses_depend_on_position_and_direction():
    edges, ridges, valid = responses_to(bar_image(), scenes.root())
    assert valid.all()
    shifted, _, _ = responses_to(bar_image(), scenes.root((0.0, 0.6, 0.0)))
    across, _, _ = responses_to(bar_image(), scenes.root(roll=np.pi / 2))
    assert edges.min() > 0.3
    assert shifted.max() < 1e-6
    assert across[0, 0, [0, -1]].max() < 1e-6  # the ends of a horizontal rod are not at an edge
    assert np.ptp(edges) < 0.05
    assert ridges.shape == (1, 1, ALONG)


def test_a_bar_has_a_ridge_response_along_its_axis():
    _, parallel, _ = responses_to(bar_image(), scenes.root())
    _, perpendicular, _ = responses_to(bar_image(), scenes.root(roll=np.pi / 2))
    middle = ALONG // 2
    assert parallel.min() > 0.3
    assert perpendicular[0, 0, [middle - 1, middle]].max() < 0.0
    assert RIDGE_SCALES_PX[1] == 4.0  # the scale for half a width of 7.5 px


@pytest.mark.parametrize("roll", [0.3, -0.8])
def test_filters_are_steered_to_the_limb(roll):
    upright, tilted = (responses_to(bar_image(roll=angle), scenes.root(roll=angle)) for angle in (0.0, roll))
    misaligned = responses_to(bar_image(roll=roll), scenes.root(roll=-roll))
    # the square window of the local contrast contains more of a tilted bar
    np.testing.assert_allclose(tilted[1].mean(), upright[1].mean(), rtol=0.1)
    np.testing.assert_allclose(tilted[0].mean(), upright[0].mean(), rtol=0.1)
    assert misaligned[0].mean() < 0.5 * tilted[0].mean()


def test_responses_are_normalized_by_the_contrast():
    faint, strong = (responses_to(bar_image(level), scenes.root()) for level in (140, 220))
    # 4 grey levels are added to contrasts of 20 and 60
    np.testing.assert_allclose(strong[0] / faint[0], (1.0 + 4.0 / 20.0) / (1.0 + 4.0 / 60.0), rtol=0.05)


def test_the_kernel_agrees_with_numpy():
    rng = np.random.default_rng(0)
    table = rng.standard_normal((2, len(scenes.PERSON.limbs), BINS)).astype(np.float32)
    poses = scenes.people(rng, 60)
    poses[0, 0] = 5.0  # behind the camera
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    images = filtered(smoothed(View(scenes.FRONT, scenes.texture(rng))))
    expected, ratios = (f(images, points, table) for f in (oracle.response_log_ratio, response_log_ratio))
    assert expected.std() > 0.05
    assert not ratios[0].any()
    # rounding to float32 may move a response to the next bin, which changes one of n terms
    equal = np.abs(ratios - expected) < 1e-6
    assert equal.mean() > 0.99
    np.testing.assert_allclose(ratios, expected, rtol=0.0, atol=2 * np.ptp(table) / len(POINTS))


@pytest.mark.parametrize("corner", [(0, 0), (150, 90), (270, 190)])
def test_a_box_is_smoothed_as_in_the_full_image(corner):
    """Also after another box of the view, and at the border of the image."""
    view = View(scenes.FRONT, scenes.texture(np.random.default_rng(2)))
    full, lazy, extended = smoothed(view), SmoothedView(view), SmoothedView(view)
    box = (*corner, corner[0] + 45, corner[1] + 45)
    extended.smoothed_around((120, 100, 160, 110))
    assert lazy.smoothed_around(box).levels.shape[1] < scenes.HEIGHT
    expected = filtered(full, box)
    for smoothed_view in (lazy, extended):
        box_responses = filtered(smoothed_view.smoothed_around(box), box)
        np.testing.assert_array_equal(box_responses.gradient, expected.gradient)
        np.testing.assert_array_equal(box_responses.ridges, expected.ridges)
    assert lazy.smoothed_around(box) is lazy.smoothed_around((*corner, corner[0] + 20, corner[1] + 30))


def test_a_learned_model_has_its_maximum_at_the_true_position(tmp_path, monkeypatch):
    """The model is learned from bars of random contrast, saved and loaded."""
    rng = np.random.default_rng(1)
    views = [View(scenes.FRONT, bar_image(int(level))) for level in rng.integers(120, 250, 8)]
    learned_poses = []
    monkeypatch.setattr(edges, "forward", lambda skeleton, p: learned_poses.append(p) or forward(skeleton, p))
    model = learn_edge_model([(ROD, view, scenes.root()[0]) for view in views], rng)
    displacements = np.stack(learned_poses)[..., :3] @ scenes.FRONT.rotation.T  # (view, pose, right and down and ahead)
    assert (displacements[:, 0] == 0.0).all()  # the true pose
    distances = np.linalg.norm(displacements[:, 1:, :2], axis=2)
    np.testing.assert_allclose([distances.min(), distances.max()], [0.05, 0.6], atol=0.03)
    np.testing.assert_allclose(displacements[..., 2], 0.0, atol=1e-12)
    assert all((side > 0.1).any() for side in (*displacements.T[:2], *-displacements.T[:2]))
    assert model.on.sum(axis=-1).tolist() == [[8 * 2 * ALONG], [8 * ALONG]]  # both sides; the axis
    save(tmp_path / "edges.h5", model, PROVENANCE)
    loaded = load(EdgeModel, tmp_path / "edges.h5")
    np.testing.assert_array_equal(loaded.log_ratio(["rod_0"]), model.log_ratio(["rod_0"]))

    likelihood = Edges(ROD, effective_responses=2.0)
    likelihood.__dict__["log_ratio"] = loaded.log_ratio(ROD.limbs.names)
    poses = np.repeat(scenes.root(), 9, axis=0)
    poses[:, 1] = np.linspace(-0.4, 0.4, 9)
    frame = scenes.frame(0, (scenes.FRONT, bar_image()))
    log_prob = scenes.log_prob(likelihood, frame, frame, poses, poses)
    assert np.argmax(log_prob) == 4
    assert log_prob[4] > np.delete(log_prob, 4).max() + 1.0


def test_empty_bins_have_a_log_ratio_of_zero():
    on, off = np.zeros((2, 1, BINS)), np.zeros((2, 1, BINS))
    on[:, 0, 3], off[:, 0, 5] = 10.0, 80.0
    ratio = EdgeModel(("rod",), on, off).log_ratio(["left_rod"])[0, 0]
    assert ratio[3] > 1.0
    assert ratio[5] < -1.0
    np.testing.assert_allclose(np.delete(ratio, [3, 5]), 0.0, atol=1e-6)


def test_neck_and_feet_outside_of_the_model_are_ignored_with_a_message(caplog):
    on, off = np.zeros((2, 1, BINS)), np.zeros((2, 1, BINS))
    on[:, 0, 3], off[:, 0, 5] = 10.0, 80.0
    model = EdgeModel(("calf",), on, off)
    ratio = model.log_ratio(["neck", "left_calf", "left_foot"])
    assert np.array_equal(ratio[:, 1:2], model.log_ratio(["right_calf"]))
    assert not ratio[:, [0, 2]].any()
    assert caplog.messages == ["edges: the model has no foot and neck; their edges are ignored"]


def test_unknown_limbs_are_an_error():
    model = EdgeModel(("thigh",), np.ones((2, 1, BINS)), np.ones((2, 1, BINS)))
    with pytest.raises(InputError, match="no limb 'tail' in the model; expected thigh"):
        model.log_ratio(["left_thigh", "tail"])


@pytest.mark.parametrize("size", [(90, 70), (3, 2), (1, 5)])
def test_derivatives_are_identical_to_those_of_opencv_in_any_box(size):
    rng = np.random.default_rng(2)
    height, width = size
    levels = rng.uniform(0.0, 255.0, (1 + len(RIDGE_SCALES_PX), height, width)).astype(np.float32)
    images = SmoothedBox(levels, rng.uniform(4.0, 50.0, size).astype(np.float32), (0, 0, width, height))
    expected, computed = oracle.filtered(images), filtered(images)
    np.testing.assert_array_equal(computed.gradient, expected.gradient)
    np.testing.assert_array_equal(computed.ridges, expected.ridges)
    left, top, right, bottom = width // 3, height // 4, width, height - height // 5
    box_responses = filtered(images, (left, top, right, bottom))
    assert box_responses.corner == (left, top)
    np.testing.assert_array_equal(box_responses.gradient, expected.gradient[top:bottom, left:right])
    np.testing.assert_array_equal(box_responses.ridges, expected.ridges[:, top:bottom, left:right])


def test_filtering_the_bounding_box_of_the_points_is_sufficient():
    """The log ratios are those of the full image, and those of an empty box are zero."""
    rng = np.random.default_rng(3)
    images, poses = smoothed(View(scenes.FRONT, scenes.texture(rng))), scenes.people(rng, 40)
    table = rng.standard_normal((2, len(scenes.PERSON.limbs), BINS)).astype(np.float32)
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    left, top, right, bottom = bounding_box(points)
    pixels = points.pixels[points.valid]
    assert (left, top) == tuple(np.floor(pixels.min(axis=0)))
    assert (right, bottom) == tuple(np.floor(pixels.max(axis=0)) + 2)
    in_box, in_image = (filtered(images, box) for box in ((left, top, right, bottom), None))
    np.testing.assert_array_equal(*(response_log_ratio(f, points, table) for f in (in_box, in_image)))
    poses[:, 0] = 5.0  # behind the camera
    points = limb_points(scenes.PERSON, POINTS, scenes.FRONT, forward(scenes.PERSON.skeleton, poses))
    assert not response_log_ratio(filtered(images, bounding_box(points)), points, table).any()


@pytest.mark.parametrize("other", [(2, 5, 7, 1), (0, 10, 2, 6)])
def test_the_box_around_two_is_the_smallest(other):
    one = (1, 9, 3, 4)
    assert _joint_box(one, other) == (*np.minimum(one, other)[:2], *np.maximum(one, other)[2:])
