"""Exchanged, unsynchronized and contradicting cameras on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import camera_arc, walker_joints

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import plain_camera
from workbench.cameras.camera_agreement import camera_findings, pair_separations
from workbench.cameras.observed_joints import ObservedJoints
from workbench.cameras.time_offset import distance_curve
from workbench.cameras.triangulation import ray_distances, triangulate_normalized

RATE_HZ = 25.0
FAR = [plain_camera(1280, 960, 9000.0, place, (0.0, 0.0, 0.0), name)
       for name, place in (("a", (-50.0, 0.0, 0.0)), ("b", (0.0, -50.0, 0.0)))]  # fmt: skip
"""Level cameras at right angles, whose rays miss each other by the difference in height, to 1 %."""


def observed(cameras, points):
    """Return the keypoints of points (V, F, J, 3), m, in the images of the cameras."""
    pixels = np.stack([camera.project(each) for camera, each in zip(cameras, points, strict=True)])
    keypoints = np.full((*pixels.shape[:2], len(JOINT_NAMES), 3), np.nan)
    keypoints[:, :, : pixels.shape[2]] = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    times_s = np.arange(pixels.shape[1]) / RATE_HZ
    return ObservedJoints(tuple(cameras), keypoints, np.ones(len(cameras), bool), times_s=times_s)


def kinds(seen, explain):
    return {finding.kind for finding in camera_findings(seen, explain)}


def changed(sign_by_camera, share, seen):
    """Move the keypoints of each camera up or down by a share of the person's height in each frame."""
    for v, sign in enumerate(sign_by_camera):
        seen.keypoints[v, ..., 1] += sign * share * np.ptp(seen.keypoints[v, ..., 1], axis=1)[:, None]
    return seen


@pytest.mark.parametrize(("n_exchanged", "expected"), [(116, False), (119, True)])
def test_an_exchange_reduces_the_distance_of_rays_to_07(n_exchanged, expected):
    # Exchanging the videos makes the other frames contradict each other: the distance is reduced to the ratio of frames
    # that are not exchanged to those that are, 84 / 116 = 0.72 and 81 / 119 = 0.68.
    seen = observed(camera_arc(2), np.tile(walker_joints()[0] + np.array([0.5, 0.5, 0.0]), (2, 200, 1, 1)))
    seen.keypoints[:, :n_exchanged] = seen.keypoints[::-1, :n_exchanged].copy()
    assert ("exchanged cameras" in kinds(seen, explain=True)) == expected


def rising(late_frames, rise_m, error_m=0.0, n=60):
    """Return a point's keypoints in two cameras, the second one late, in which it rises by rise_m per frame and is
    alternately too high and too low by error_m."""
    frames = np.arange(n)
    heights = np.stack([frames, frames - late_frames]) * rise_m
    heights[1] += error_m * (-1.0) ** frames
    return observed(FAR, np.stack([0.0 * heights, 0.0 * heights, heights - heights.mean()], axis=-1)[:, :, None])


@pytest.mark.parametrize(
    ("late_m", "error_m", "expected"),
    [(0.080, 0.055, True), (0.080, 0.057, False), (0.200, 0.074, True), (0.200, 0.076, False)],
)
def test_a_shift_reduces_the_distance_of_rays_to_07_and_75_millimetres(late_m, error_m, expected):
    seen = rising(4, late_m / 4, error_m)
    assert ("unsynchronized cameras" in kinds(seen, explain=False)) == expected


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("late_frames", "n", "expected"), [(11, 60, True), (12, 60, False), (9, 30, True), (10, 30, False)]
)
def test_shifts_are_less_than_half_a_second_and_a_third_of_the_frames(late_frames, n, expected, sign):
    seen = rising(sign * late_frames, 0.02, n=n)
    assert ("unsynchronized cameras" in kinds(seen, explain=False)) == expected


@pytest.mark.parametrize(("share", "expected"), [(0.0435, False), (0.0445, True)])
def test_rays_miss_each_other_by_0044_of_the_persons_height(share, expected):
    seen = changed((-1.0, 1.0), share, observed(camera_arc(2), np.tile(walker_joints(), (2, 1, 1, 1))))
    assert ("inconsistent cameras" in kinds(seen, explain=False)) == expected


@pytest.mark.parametrize(("n_cameras", "n_more"), [(2, 0), (3, 1), (4, 4)])
def test_two_pairs_that_contradict_each_other_are_named_and_the_others_counted(n_cameras, n_more):
    seen = observed(camera_arc(n_cameras), np.tile(walker_joints(), (n_cameras, 1, 1, 1)))
    seen = changed(0.1 * np.arange(n_cameras), 1.0, seen)  # rays of every two cameras miss each other
    (finding,) = camera_findings(seen, explain=False)
    assert finding.message.count("miss each other") == min(n_cameras, 2) - (n_cameras == 2)
    assert (f"{n_more} more pairs" in finding.message) == bool(n_more)


def test_a_point_behind_the_cameras_counts_as_the_persons_height():
    cameras = [plain_camera(1280, 960, 900.0, (-5.0, y, 1.0), (0.0, y, 1.0), f"c{y}") for y in (-1.0, 1.0)]
    seen = observed(cameras, np.tile(walker_joints()[:5], (2, 1, 1, 1)))
    seen.keypoints[0, ..., 0], seen.keypoints[1, ..., 0] = 1200.0, 80.0  # rays that diverge
    (separations,) = pair_separations(seen).values()
    assert separations.tolist() == [1.0] * 5


@pytest.mark.parametrize(("late_frames", "n_compared"), [(0.50, 10), (0.52, 9)])
def test_frames_of_two_cameras_are_compared_up_to_051_intervals_apart(late_frames, n_compared):
    frames, rays = np.arange(10.0), np.tile([1.0, 0.0, 0.0], (10, 1))
    curve = distance_curve(rays, frames, rays, frames + late_frames, np.ones(3), np.zeros(1), len)
    assert curve.tolist() == [n_compared]


@pytest.mark.parametrize(("sine", "is_known"), [(0.049, False), (0.051, True)])
def test_distances_of_rays_are_known_from_a_sine_of_005_on(sine, is_known):
    rays = np.array([[1.0, 0.0, 0.0], [np.sqrt(1.0 - sine**2), sine, 0.0]])
    assert np.isfinite(ray_distances(*rays, np.array([0.0, 0.0, 1.0]))) == is_known


@pytest.mark.parametrize(("sine", "is_known"), [(2.2e-5, False), (2.3e-5, True)])
def test_rays_that_are_not_parallel_determine_a_point(sine, is_known):
    cameras = [plain_camera(640, 480, 500.0, (0.0, y, 1.0), (5.0, y, 1.0)) for y in (0.0, 1.0)]
    point = triangulate_normalized(cameras, np.array([[0.0, 0.0], [sine, 0.0]]))  # the determinant is 2 sine²: 1e-9
    assert np.isfinite(point).all() == is_known


@pytest.mark.parametrize(("n_joints", "shows"), [(3, False), (4, True)])
def test_four_keypoints_show_a_person(n_joints, shows):
    seen = observed(FAR[:1], walker_joints()[None, :1])
    seen.keypoints[0, 0, n_joints:] = np.nan
    assert seen.shows_person.tolist() == [[shows]]


@pytest.mark.parametrize(("seconds", "is_motion"), [(0.49, True), (0.51, False)])
def test_keypoints_move_from_frame_to_frame_within_half_a_second(seconds, is_motion):
    seen = replace(observed(FAR[:1], walker_joints()[None, :2]), times_s=np.array([0.0, seconds]))
    assert np.isfinite(seen.motion).tolist() == [False, is_motion]
