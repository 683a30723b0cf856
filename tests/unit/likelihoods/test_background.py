"""The background likelihood against closed forms, and for a walking person."""

from types import SimpleNamespace

import likelihood_scenes as scenes
import numpy as np
import pytest
from still_clips import EPSILON, by_hand, clip, of_frames, with_block

from tests.oracles.image_motion import PosedView, limb_patches
from workbench.body.kinematics import forward
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.cues.background import Background, contour_samples
from workbench.likelihoods.cues.image_levels import log_ratio, median_over_frames, static_background
from workbench.likelihoods.image_motion import ImageMotion, regular_samples

ROD = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))


def test_median_and_deviation_of_a_pixel_are_robust():
    """Two of seven levels are outliers; the others are 100 with deviations −4, −2, 0, 2, 4."""
    levels = np.array([96.0, 98.0, 230.0, 100.0, 102.0, 250.0, 104.0], np.float32)
    background = static_background(np.repeat(levels, 4).reshape(7, 2, 2, 1))
    np.testing.assert_array_equal(background.median, 102.0)
    np.testing.assert_allclose(background.sigma, 1.4826 * 4.0, rtol=1e-6)  # |deviations| 6 4 128 2 0 148 2
    np.testing.assert_array_equal(static_background(np.full((3, 2, 2, 1), 7.0, np.float32)).sigma, 3.0)


@pytest.mark.parametrize("n_frames", [1, 6, 7])
def test_the_median_over_frames_is_that_of_numpy(n_frames):
    stack = np.random.default_rng(0).uniform(0.0, 255.0, (n_frames, 5, 4, 3)).astype(np.float32)
    median = median_over_frames(stack)
    assert median.dtype == np.float32
    np.testing.assert_array_equal(median, np.median(stack, axis=0))


@pytest.fixture
def sharp(monkeypatch):
    """Images are not smoothed."""
    monkeypatch.setattr("workbench.likelihoods.cues.background.BLUR_PX", 0.0)


@pytest.mark.parametrize("difference", [0.0, 3.0, 60.0])
def test_the_log_ratio_of_a_pixel_is_the_closed_form(difference, sharp):
    cache, frames = clip(*[scenes.flat(100)] * 3, scenes.flat(100 + int(difference)))
    likelihood = Background(ROD, cache)
    ratio = log_ratio(frames[-1].views[0], likelihood.backgrounds, 0.0, EPSILON)
    np.testing.assert_allclose(ratio, by_hand(difference), rtol=1e-5)


@pytest.mark.parametrize("channels", [(80, 80, 80), (80, 0, 0), (3, 0, 6)])
def test_the_log_ratio_of_a_colour_image_is_that_of_its_rms_deviation(channels, sharp):
    empty = np.full((scenes.HEIGHT, scenes.WIDTH, 3), 100, np.uint8)
    cache, frames = clip(empty, empty, empty, empty + np.array(channels, np.uint8))
    background = Background(ROD, cache).backgrounds["front"]
    assert background.median.shape == empty.shape
    ratio = log_ratio(frames[-1].views[0], {"front": background}, 0.0, EPSILON)
    np.testing.assert_allclose(ratio, by_hand(np.sqrt(np.mean(np.square(channels)))), rtol=1e-5)


def test_a_limb_on_the_foreground_has_the_ratio_inside_less_that_outside(sharp):
    """The foreground is the rod's silhouette: r(80) inside, r(0) outside; a rod on the background has r(0) − r(0)."""
    view = PosedView(scenes.FRONT, np.zeros((240, 320), np.float32), forward(ROD.skeleton, scenes.root()))
    corners = limb_patches(ROD.limbs, view).corners[0, 0].reshape(-1, 2)
    (left, top), (right, bottom) = np.ceil(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    empty = scenes.flat(100)
    cache, frames = clip(empty, empty, empty, with_block(empty, 180, slice(top, bottom), slice(left, right)))
    likelihood = Background(ROD, cache, effective_pixels=2.0)
    poses = np.concatenate(
        [scenes.root(), scenes.root((0.0, 1.0, 0.0)), scenes.root((scenes.DISTANCE + 3.0, 0.0, 0.0))]
    )
    log_prob = scenes.log_prob(likelihood, frames[2], frames[3], poses, poses)
    # points are at least 0.2 half widths or 1.5 px inside the outline and 0.15 outside: interpolation does not cross it
    np.testing.assert_allclose(log_prob, [2.0 * (by_hand(80.0) - by_hand(0.0)), 0.0, 0.0], rtol=1e-5, atol=1e-9)


def test_contour_samples_lie_outside_of_the_limb():
    inside = regular_samples(300, np.random.default_rng(0))
    outside = contour_samples(inside)
    beyond = outside[:, 0] > 1.0
    assert beyond.sum() == 100
    assert (outside[beyond, 0] >= 1.25).all()
    assert (np.abs(outside[~beyond, 1]) >= 1.15).all()
    np.testing.assert_array_equal(np.sign(outside[~beyond, 1]), np.sign(inside[~beyond, 1]))


@pytest.fixture(scope="module")
def walk():
    dataset = Synthetic(n_frames=24, rate_hz=10.0, width=320, height=240, person_px=130.0, focal_px=350.0)
    frames = list(dataset.frames())
    return SimpleNamespace(clip=of_frames(frames), frames=frames, body=dataset.body)


def test_the_background_distinguishes_a_walker_from_a_body_at_rest(walk):
    """Image motion alone prefers a body at rest on the static background."""
    image_motion, background = ImageMotion(walk.body), Background(walk.body, walk.clip)
    margins = []
    for previous_frame, frame in zip(walk.frames[8:15], walk.frames[9:16], strict=True):
        true_previous, true_pose = (np.array([frame.truth.pose]) for frame in (previous_frame, frame))
        at_rest = true_previous + np.r_[1.2, np.zeros(24)] * (1.0 if true_previous[0, 0] < 0.0 else -1.0)
        previous, poses = np.concatenate([true_previous, at_rest]), np.concatenate([true_pose, at_rest])
        motion_log_prob = scenes.log_prob(image_motion, previous_frame, frame, previous, poses)
        assert motion_log_prob[1] > motion_log_prob[0]  # no motion there
        background_log_prob = scenes.log_prob(background, previous_frame, frame, previous, poses)
        margins.append(background_log_prob[0] - background_log_prob[1])
    assert min(margins) > 5.0


def test_the_background_is_estimated_from_equally_spaced_frames():
    """The median of the first, the middle and the last of seven frames is the level of the middle one."""
    cache, _ = clip(*[scenes.flat(level) for level in (10, 0, 0, 20, 0, 0, 90)])
    np.testing.assert_array_equal(Background(ROD, cache, n_frames=3).backgrounds["front"].median, 20.0)
    np.testing.assert_array_equal(Background(ROD, cache, n_frames=60).backgrounds["front"].median, 0.0)
