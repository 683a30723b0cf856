"""Losses and uncertainty of a run on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import HEIGHT_M, RATE_HZ, N, RunInputs, level, scene

from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict.run_verdict import verdict

ONE = scene(1, 0.0).measurements()
INPUTS = RunInputs(HEIGHT_M, rate_hz=RATE_HZ)
AFTER = np.arange(N) >= 1
"""Frames after the first, whose pose is given: 59."""
KEYPOINTS = {"mpjpe_px": 2.0, "forearm_width_px": 20.0, "mpjpe_mm": 60.0, "mpjpe_abs_mm": 60.0}


def with_truth(**errors):
    """Return measurements with errors by a ground truth, which are small if not given."""
    every = {name: np.broadcast_to(value, N).astype(float) for name, value in (KEYPOINTS | errors).items()}
    return replace(ONE, errors=every)


def outcome(measured):
    """Return the kind and the level of the outcome."""
    result = verdict(measured, INPUTS).outcome
    return result.kind, result.level


@pytest.mark.parametrize(("error_mm", "kind"), [(149.0, "tracked"), (151.0, "lost")])
def test_a_person_is_lost_from_a_root_aligned_error_of_150_millimetres_on(error_mm, kind):
    assert outcome(with_truth(mpjpe_mm=error_mm))[0] == kind


@pytest.mark.parametrize(("error_mm", "kind"), [(149.0, "tracked"), (151.0, "lost")])
def test_a_person_without_images_is_lost_from_an_error_of_150_millimetres_on(error_mm, kind):
    measured = replace(scene(0).measurements(), errors={"mpjpe_abs_mm": np.full(N, error_mm)})
    assert outcome(measured)[0] == kind


@pytest.mark.parametrize(("error_px", "kind"), [(19.9, "tracked"), (20.1, "lost")])
def test_a_person_is_lost_in_the_image_from_the_width_of_a_forearm_on(error_px, kind):
    assert outcome(with_truth(mpjpe_px=error_px))[0] == kind


@pytest.mark.parametrize(("share", "kind"), [(0.0435, "no ground truth"), (0.0445, "lost")])
def test_a_person_without_ground_truth_is_lost_from_0044_of_the_height_on(share, kind):
    distances_px = np.tile(share * ONE.person_height_px[..., None], len(JOINT_NAMES))
    assert outcome(replace(ONE, keypoint_distances_px=distances_px))[0] == kind


@pytest.mark.parametrize(("n_lost", "factor", "expected"), [
    (29, 2.1, "doubtful"), (30, 2.1, "not usable"), (30, 1.9, "doubtful"), (59, 1.9, "doubtful"),
])  # fmt: skip
def test_a_run_is_not_usable_if_lost_in_half_of_the_frames_by_twice_the_threshold(n_lost, factor, expected):
    assert AFTER.sum() == 59
    lost = np.arange(N) >= N - n_lost
    assert outcome(with_truth(mpjpe_mm=np.where(lost, factor * 150.0, 1.0))) == ("lost", expected)


@pytest.mark.parametrize(("far_mm", "kind"), [(345.0, "tracked"), (355.0, "lost")])
def test_a_large_error_in_one_frame_is_averaged_over_five(far_mm, kind):
    # (far_mm + 4 · 100 mm) / 5 is 149 and 151 mm; the mean over four frames is 161 mm and over six 143 mm.
    assert outcome(with_truth(mpjpe_mm=np.where(np.arange(N) == 30, far_mm, 100.0)))[0] == kind


def drifting(drift_mm, std_m=0.0, frames=AFTER):
    """Return measurements with an error in depth in some frames (N,), known to a standard deviation."""
    return replace(with_truth(), depth_error_m=1e-3 * np.where(frames, drift_mm, 0.0), depth_std_m=np.full(N, std_m))


@pytest.mark.parametrize(("drift_mm", "std_m", "expected"), [
    (149.0, 0.0, ""), (151.0, 0.0, "doubtful"), (-151.0, 0.0, "doubtful"),
    (328.0, 0.2, ""), (330.0, 0.2, "doubtful"),  # the 90 % interval of a normal distribution: ± 1.645 · 200 mm
])  # fmt: skip
def test_a_drift_in_depth_exceeds_150_millimetres_and_the_90_percent_interval(drift_mm, std_m, expected):
    assert level(drifting(drift_mm, std_m), "depth drift") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(5, ""), (7, "doubtful")])
def test_a_drift_in_depth_is_the_mean_over_half_a_second(n_frames, expected):
    # 12 frames at 25 Hz: 5 / 12 · 310 mm = 129 mm, 7 / 12 · 310 mm = 181 mm.
    assert level(drifting(310.0, frames=np.arange(N) // n_frames == 4), "depth drift") == expected


@pytest.mark.parametrize(("std_m", "expected"), [(0.449, ""), (0.451, "doubtful")])
def test_a_depth_is_uncertain_from_45_centimetres_on(std_m, expected):
    assert level(replace(ONE, depth_std_m=np.full(N, std_m)), "uncertain depth") == expected


@pytest.mark.parametrize(("error_mm", "expected"), [(449.0, ""), (451.0, "doubtful")])
def test_joints_are_uncertain_from_45_centimetres_on(error_mm, expected):
    stated = replace(scene(1), errors={"expected_error_legs_mm": np.full(N, error_mm)})
    assert level(stated.measurements(), "large expected error") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(30, ""), (31, "doubtful")])
def test_joints_are_uncertain_in_half_of_the_frames(n_frames, expected):
    groups = tuple(("legs",) if t < n_frames else () for t in range(N))
    assert level(replace(ONE, uncertain_groups=groups), "large expected error") == expected
