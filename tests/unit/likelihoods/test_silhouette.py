"""The silhouette likelihood: unions of outlines against NumPy and closed forms."""

import likelihood_scenes as scenes
import numpy as np
from still_clips import by_hand, clip, of_frames, with_block

from tests.oracles import outlines as oracle
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.cues.outlines import OUTWARDS, outline_sums, running_sums
from workbench.likelihoods.cues.silhouette import Silhouette

ROD = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))


def box(x, y, half_width, half_height, angle=0.0):
    """Return the outline (4, 2) of a rectangle rotated by `angle`, rad."""
    corners = OUTWARDS[:, ::-1] * [half_width, half_height]
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return corners @ rotation.T + [x, y]


def test_the_kernel_agrees_with_numpy():
    rng = np.random.default_rng(0)
    image = rng.normal(size=(60, 80)).astype(np.float32)
    outlines = np.array(
        [[box(*rng.uniform(-10, 90, 2), *rng.uniform(3, 20, 2), rng.uniform(0, 6)) for _ in range(6)] for _ in range(9)]
    )
    spheres = np.array([False, False, True, False, False, True])
    for k in np.flatnonzero(spheres):
        outlines[:, k] = outlines[:, k].mean(axis=1, keepdims=True) + 9.0 * OUTWARDS
    outlines[3, 1], outlines[4, 2] = 0.0, np.nan  # outside of the image, and not projected
    for dilation_px in (0.0, 0.4, 3.0):
        sums = outline_sums(running_sums(image), outlines.astype(np.float32), spheres, dilation_px)
        expected = oracle.outline_sums(image, outlines.astype(np.float32), spheres, dilation_px)
        np.testing.assert_allclose(sums, expected, atol=1e-3)  # 1000 pixels; rounding of corners is 1e-6 of 100 px


def test_sums_of_ones_are_the_areas_of_unions():
    ones, not_spheres = running_sums(np.ones((100, 120), np.float32)), np.zeros(2, dtype=bool)
    first, second = box(30.0, 40.5, 10.0, 20.0), box(35.0, 50.5, 10.0, 20.0)
    outside = box(200.0, 50.0, 10.0, 10.0)
    pairs = np.array([[first, outside], [first, second], [first, first]], dtype=np.float32)
    # boxes of 20 × 40 with an intersection of 15 × 30
    np.testing.assert_allclose(outline_sums(ones, pairs, not_spheres), [800.0, 2 * 800.0 - 450.0, 800.0], rtol=1e-6)
    np.testing.assert_allclose(outline_sums(ones, pairs[:1], not_spheres, 1.0), [22.0 * 42.0], rtol=1e-6)
    disc = np.array([[box(60.0, 50.0, 20.0, 20.0)]], dtype=np.float32)
    radius = 20.0 * np.sqrt(2.0) + 0.5
    area = outline_sums(ones, disc, np.ones(1, dtype=bool), 0.5)
    np.testing.assert_allclose(area, np.pi * radius**2, rtol=2e-3)  # rows of pixels


def test_the_value_of_a_rod_is_the_mean_ratio_of_its_pixels():
    """The ratio is k r(80) on the foreground, k r(0) on the background, and their mean at the border."""
    empty = scenes.flat(100)
    cache, frames = clip(empty, empty, empty, with_block(empty, 180, slice(None), slice(0, 160)))
    likelihood = Silhouette(ROD, cache, effective_pixels=2.0, dilation_px=0.0)
    likelihood = scenes.after_first_frame(likelihood, frames[0], scenes.root()[0])
    poses = np.concatenate([scenes.root((0.0, y, 0.0)) for y in (0.8, -0.8, 0.0)])
    values = scenes.log_prob(likelihood, frames[2], frames[3], poses, poses)
    tolerance = 1 / 40  # one of the rod's 46 rows may be added or omitted
    in_order = sorted(values)
    np.testing.assert_allclose(in_order[0], 2.0 * by_hand(0.0), rtol=tolerance)
    np.testing.assert_allclose(in_order[2], 2.0 * by_hand(80.0), rtol=tolerance)
    # one of about 30 columns of pixels is at the border
    np.testing.assert_allclose(values[2], by_hand(0.0) + by_hand(80.0), atol=2.0 * by_hand(80.0) / 25)


def test_the_estimated_distance_is_unbiased():
    """The maximum over poses moved along the line of sight, for all frames of a walk, is within 1 cm of the truth."""
    dataset = Synthetic(n_frames=24, rate_hz=8.0, perturb=False)
    frames, offsets_m = list(dataset.frames()), np.linspace(-0.1, 0.1, 41)
    likelihood, total = Silhouette(dataset.body, of_frames(frames)), np.zeros(41)
    camera = frames[0].views[0].camera
    for frame in frames:
        pose = frame.truth.pose
        moved = np.repeat(pose[None], 41, axis=0)
        sight = pose[:3] - camera.position
        moved[:, :3] += offsets_m[:, None] * sight / np.linalg.norm(sight)
        likelihood = likelihood.prepare(frame, frame).update(pose)
        total += scenes.log_prob(likelihood, frame, frame, moved, moved)
    assert abs(offsets_m[np.argmax(total)]) <= 0.01  # an error of dilation_px of 0.1 px is 4 mm at 4 m
    assert total.max() - total[[10, 30]].max() > len(frames) * 0.5  # errors of 5 cm


def test_without_an_initial_pose_the_value_is_zero_with_a_note():
    cache, frames = clip(*[scenes.flat(100)] * 3)
    frame_likelihood = Silhouette(ROD, cache).prepare(frames[0], frames[1])
    assert frame_likelihood.evaluate(scenes.root(), scenes.root()).log_prob == 0.0
    assert "the person's area in camera front is not known yet" in frame_likelihood.notes[0]
    assert Silhouette(ROD, cache).prepare(None, frames[0]).notes == ()
