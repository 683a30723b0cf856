"""The background term where the answer is known: flat scenes, a person who walks through, a person who stays."""

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
    """Of seven frames two show a person; the others lie about 100 by −4, −2, 0, 2, 4."""
    levels = np.array([96.0, 98.0, 230.0, 100.0, 102.0, 250.0, 104.0], np.float32)
    found = static_background(np.repeat(levels, 4).reshape(7, 2, 2, 1))
    np.testing.assert_array_equal(found.median, 102.0)
    np.testing.assert_allclose(found.sigma, 1.4826 * 4.0, rtol=1e-6)  # |deviations| 6 4 128 2 0 148 2
    np.testing.assert_array_equal(static_background(np.full((3, 2, 2, 1), 7.0, np.float32)).sigma, 3.0)


@pytest.mark.parametrize("n_frames", [1, 6, 7])
def test_the_median_over_frames_is_that_of_numpy(n_frames):
    stack = np.random.default_rng(0).uniform(0.0, 255.0, (n_frames, 5, 4, 3)).astype(np.float32)
    found = median_over_frames(stack)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, np.median(stack, axis=0))


@pytest.fixture
def sharp(monkeypatch):
    """Images are not smoothed."""
    monkeypatch.setattr("workbench.likelihoods.cues.background.BLUR_PX", 0.0)


@pytest.mark.parametrize("difference", [0.0, 3.0, 60.0])
def test_ratio_of_a_pixel(difference, sharp):
    still, frames = clip(*[scenes.flat(100)] * 3, scenes.flat(100 + int(difference)))
    likelihood = Background(ROD, still)
    found = log_ratio(frames[-1].views[0], likelihood.backgrounds, 0.0, EPSILON)
    np.testing.assert_allclose(found, by_hand(difference), rtol=1e-5)


@pytest.mark.parametrize("channels", [(80, 80, 80), (80, 0, 0), (3, 0, 6)])
def test_channels_count_as_one(channels, sharp):
    """Their deviations are averaged: three equal ones say what a grey image says."""
    empty = np.full((scenes.HEIGHT, scenes.WIDTH, 3), 100, np.uint8)
    still, frames = clip(empty, empty, empty, empty + np.array(channels, np.uint8))
    scene = Background(ROD, still).backgrounds["front"]
    assert scene.median.shape == empty.shape
    found = log_ratio(frames[-1].views[0], {"front": scene}, 0.0, EPSILON)
    np.testing.assert_allclose(found, by_hand(np.sqrt(np.mean(np.square(channels)))), rtol=1e-5)


def test_a_limb_that_fills_the_change_gets_the_ratio_inside_and_outside(sharp):
    """What changed is the rod's silhouette: inside r(80), about it −r(0); a rod elsewhere gets r(0) − r(0) = 0."""
    view = PosedView(scenes.FRONT, np.zeros((240, 320), np.float32), forward(ROD.skeleton, scenes.root()))
    corners = limb_patches(ROD.limbs, view).corners[0, 0].reshape(-1, 2)
    (left, top), (right, bottom) = np.ceil(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    empty = scenes.flat(100)
    still, frames = clip(empty, empty, empty, with_block(empty, 180, slice(top, bottom), slice(left, right)))
    likelihood = Background(ROD, still, effective_pixels=2.0)
    poses = np.concatenate(
        [scenes.root(), scenes.root((0.0, 1.0, 0.0)), scenes.root((scenes.DISTANCE + 3.0, 0.0, 0.0))]
    )
    found = scenes.log_prob(likelihood, frames[2], frames[3], poses, poses)
    # points lie 0.2 half widths or 1.5 px within the outline and 0.15 outside of it: interpolation reaches no further
    np.testing.assert_allclose(found, [2.0 * (by_hand(80.0) - by_hand(0.0)), 0.0, 0.0], rtol=1e-5, atol=1e-9)


def test_points_about_a_limb_lie_beside_it_and_beyond_its_end():
    inside = regular_samples(300, np.random.default_rng(0))
    about = contour_samples(inside)
    beyond = about[:, 0] > 1.0
    assert beyond.sum() == 100
    assert (about[beyond, 0] >= 1.25).all()
    assert (np.abs(about[~beyond, 1]) >= 1.15).all()
    np.testing.assert_array_equal(np.sign(about[~beyond, 1]), np.sign(inside[~beyond, 1]))


@pytest.fixture(scope="module")
def walk():
    dataset = Synthetic(n_frames=24, rate_hz=10.0, width=320, height=240, person_px=130.0, focal_px=350.0)
    frames = list(dataset.frames())
    return SimpleNamespace(clip=of_frames(frames), frames=frames, body=dataset.body)


def test_a_body_at_rest_on_a_still_background_is_no_longer_as_good_as_the_truth(walk):
    """The bare image-motion term cannot tell the walker from a body at rest beside him; this can, in every frame."""
    bare, background = ImageMotion(walk.body), Background(walk.body, walk.clip)
    gained = []
    for before, now in zip(walk.frames[8:15], walk.frames[9:16], strict=True):
        true_before, true_now = (np.array([frame.truth.pose]) for frame in (before, now))
        aside = true_before + np.r_[1.2, np.zeros(24)] * (1.0 if true_before[0, 0] < 0.0 else -1.0)
        previous, poses = np.concatenate([true_before, aside]), np.concatenate([true_now, aside])
        paper = scenes.log_prob(bare, before, now, previous, poses)
        assert paper[1] > paper[0]  # nothing moves there, so that it even wins
        ratio = scenes.log_prob(background, before, now, previous, poses)
        gained.append(ratio[0] - ratio[1])
    assert min(gained) > 5.0


def test_the_frames_it_is_learned_from_are_spread_over_the_clip():
    """Of seven frames the first, the middle and the last, whose median is the middle one's level."""
    still, _ = clip(*[scenes.flat(level) for level in (10, 0, 0, 20, 0, 0, 90)])
    np.testing.assert_array_equal(Background(ROD, still, n_frames=3).backgrounds["front"].median, 20.0)
    np.testing.assert_array_equal(Background(ROD, still, n_frames=60).backgrounds["front"].median, 0.0)
