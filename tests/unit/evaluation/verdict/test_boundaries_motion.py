"""Findings on the estimated limbs and walk on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, N, level, point_scene, scene, walk

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS
from workbench.evaluation.verdict.motion_findings import motion_findings
from workbench.evaluation.verdict.run_measurements import foot_speeds, walking_velocity

ONE, TWO, POINTS = (each.measurements() for each in (scene(1, 0.0), scene(2, 0.0), point_scene()))
ANKLES = [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]


def lengths(height_m, **factors):
    return {limb: factors.get(limb, 1.0) * height_m * getattr(from_height(1.0), limb) for limb in LIMBS}


@pytest.mark.parametrize(("height_m", "expected"), [(1.19, "doubtful"), (1.21, ""), (2.19, ""), (2.21, "doubtful")])
def test_the_body_is_12_to_22_metres_tall(height_m, expected):
    assert level(replace(ONE, lengths_m=lengths(height_m)), "height mismatch") == expected


@pytest.mark.parametrize(
    ("height_m", "factor", "expected"),
    [
        (1.2, 0.92, False), (1.2, 0.90, True), (1.19, 1.0, True), (2.2, 1.09, False), (2.2, 1.11, True),
        (2.21, 1.0, True), (2.21, 0.99, True),
    ],
)  # fmt: skip
def test_a_configured_height_counts_where_the_limbs_agree_within_10_percent(height_m, factor, expected):
    measured = replace(ONE, lengths_m=lengths(factor * height_m))
    assert any(each.kind == "height mismatch" for each in motion_findings(measured, height_m)) == expected


@pytest.mark.parametrize(("factor", "expected"), [(1.09, False), (1.11, True), (1 / 1.09, False), (1 / 1.11, True)])
def test_any_height_is_expected_that_is_configured_and_measured_by_the_cameras(factor, expected):
    small = replace(TWO, lengths_m=lengths(0.62))
    for measured, height_m, is_found in ((small, HEIGHT_M * factor, expected), (small, None, True)):
        assert any(each.kind == "height mismatch" for each in motion_findings(measured, height_m)) == is_found


# A limb that is longer by a factor raises the mean over the logarithms of four limbs, so that it exceeds the average
# person's by the factor to the power of 3/4: 1.25 for 1.347.
FACTORS = [(1 / 1.36, "doubtful"), (1 / 1.33, ""), (1.33, ""), (1.36, "doubtful")]


@pytest.mark.parametrize("limb", LIMBS)
@pytest.mark.parametrize(("factor", "expected"), FACTORS)
def test_a_limb_of_the_body_differs_from_the_others_by_25_percent(limb, factor, expected):
    assert level(replace(ONE, lengths_m=lengths(HEIGHT_M, **{limb: factor})), "implausible limb lengths") == expected


@pytest.mark.parametrize(("factor", "expected"), FACTORS)
def test_a_triangulated_limb_differs_from_the_others_by_25_percent(factor, expected):
    body = person(from_height(HEIGHT_M, forearm=factor * 0.146 * HEIGHT_M))
    keypoints = TWO.observed.keypoints.copy()
    for v, camera in enumerate(TWO.observed.cameras):
        keypoints[v, ..., :2] = camera.project(joints(body.skeleton, walk()))
    measured = replace(TWO, observed=replace(TWO.observed, keypoints=keypoints))
    assert level(measured, "implausible limb lengths") == expected


@pytest.mark.parametrize(("height_m", "expected"), [(0.49, ""), (0.51, "doubtful"), (2.49, "doubtful"), (2.51, "")])
def test_limbs_are_those_of_a_person_of_05_to_25_metres(height_m, expected):
    limbs = lengths(height_m, forearm=1.4)
    scale = height_m / np.exp(np.mean([np.log(limbs[limb] / lengths(1.0)[limb]) for limb in LIMBS]))
    scaled = {limb: scale * length for limb, length in limbs.items()}
    assert level(replace(ONE, lengths_m=scaled), "implausible limb lengths") == expected


def walker(feet=0.0, faces_deg=0.0, n_walking=N):
    """Return measurements of a person who walks along x at 1 m/s and faces another direction in some frames.

    feet: (N,) speed of both feet over the pelvis'. faces_deg: (N,) angle from the direction of the walk. n_walking:
    frames with points.
    """
    angles = np.radians(np.broadcast_to(faces_deg, N))
    turns = np.zeros((N, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 0, 1], turns[:, 2, 2] = np.sin(angles), -np.sin(angles), 1.0
    places = np.einsum("fij,fkj->fki", turns, joints(BODY.skeleton, np.zeros((N, 25))))
    places[:, ANKLES, :2] = 0.0
    speeds = np.ones((N, len(JOINT_NAMES)))
    speeds[:, ANKLES] = np.broadcast_to(feet, N)[:, None]
    places[..., 0] += np.cumsum(speeds, axis=0) / RATE_HZ
    extents = np.where((np.arange(N) < n_walking)[:, None], POINTS.point_extent_m, np.nan)
    return replace(POINTS, estimated_joints=places, point_extent_m=extents)


@pytest.mark.parametrize(("feet", "expected"), [(0.49, ""), (0.51, "doubtful")])
def test_the_standing_foot_slides_at_half_of_the_speed_of_the_pelvis(feet, expected):
    assert level(walker(feet), "ground contact") == expected


@pytest.mark.parametrize(("n_standing", "expected"), [(20, "doubtful"), (21, "")])
def test_a_foot_stands_in_a_third_of_the_frames(n_standing, expected):
    measured = walker(np.where(np.arange(N) < n_standing, 0.0, 0.9))
    speeds = foot_speeds(measured.pelvis_and_ankles[:, 1:], measured.times_s)
    assert (N, (speeds.max(axis=1) < 0.5).sum()) == (60, n_standing)
    assert level(measured, "ground contact") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(19, ""), (20, "doubtful")])
def test_a_walk_has_20_frames(n_frames, expected):
    assert level(walker(0.9, n_walking=n_frames), "ground contact") == expected


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("degrees", "expected"), [(119.0, ""), (121.0, "doubtful")])
def test_a_person_who_walks_backwards_faces_120_degrees_from_the_way(degrees, expected, sign):
    assert level(walker(faces_deg=sign * degrees), "left–right swap") == expected


@pytest.mark.parametrize(("n_backwards", "expected"), [(30, ""), (31, "doubtful")])
def test_a_person_walks_backwards_in_half_of_the_frames(n_backwards, expected):
    assert N == 60
    assert level(walker(faces_deg=np.where(np.arange(N) < n_backwards, 180.0, 0.0)), "left–right swap") == expected


@pytest.mark.parametrize(("speed_m_s", "walks"), [(0.29, False), (0.31, True)])
def test_a_person_walks_from_03_metres_per_second_on(speed_m_s, walks):
    times_s = np.arange(N) / RATE_HZ
    assert np.isfinite(walking_velocity(np.outer(times_s, [speed_m_s, 0.0, 0.0]), times_s)).all() == walks


@pytest.mark.parametrize(("seconds", "is_known"), [(0.49, False), (0.51, True)])
def test_a_walk_lasts_half_a_second(seconds, is_known):
    times_s = np.linspace(0.0, seconds, 20)
    assert np.isfinite(walking_velocity(np.outer(times_s, [1.0, 0.0, 0.0]), times_s)).all() == is_known


def test_speeds_are_differences_over_half_a_second_of_the_pelvis_and_007_seconds_of_a_foot():
    times_s = np.arange(100) / 50.0
    steps = np.where(np.arange(100) < 50, 0.0, 1.0)[:, None] * [1.0, 0.0, 0.0]  # between frames 49 and 50, at 0.99 s
    assert np.flatnonzero(np.isfinite(walking_velocity(steps, times_s)[:, 0])).tolist() == list(range(25, 75))
    assert np.flatnonzero(foot_speeds(steps[:, None], times_s)[:, 0]).tolist() == list(range(47, 53))
