"""The table of planted faults: faults change what they are said to change, and a verdict is judged by the result."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.tables import fault_clips, faults
from analysis.tables.fault_clips import ONE, SEVERAL
from analysis.tables.fault_kinds import FAULTS, faulty
from analysis.tables.faults import FAILED, REFUSED, Errors, Job, Outcome, is_right, is_worse
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, TRUSTWORTHY

CLEAN = Errors(pose_m=0.05, place_m=0.06, facing=0.0, speed=0.95, covered=1.0)


@cache
def clip():
    return fault_clips.subject("tall walker", None)


def is_equal(first, second):
    """Return whether the files of two clips are the same."""
    arrays = [
        (each.keypoints, each.landmarks, each.images, each.height_m, each.rate_hz, np.array(each.people),
         *(camera.row for camera in each.cameras))
        for each in (first, second)
    ]  # fmt: skip
    return all(
        np.shape(a) == np.shape(b) and np.array_equal(a, b, equal_nan=True) for a, b in zip(*arrays, strict=True)
    )


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_the_files_and_not_the_truth(name):
    changed = faulty(clip(), name)
    assert not is_equal(changed, clip())
    assert changed.truth is clip().truth
    assert len(changed.times) == len(changed.images) == changed.keypoints.shape[1]
    assert is_equal(changed, faulty(clip(), name))


def test_landmarks_lie_along_the_axes_of_the_camera():
    camera, landmarks = clip().cameras[0], clip().landmarks[0]
    seen = camera.to_camera(clip().truth)
    seen -= seen[:, :1]
    signs = np.sign(landmarks) == np.sign(seen)
    assert signs[..., :2][np.abs(seen[..., :2]) > 0.1].mean() > 0.97
    assert 0.7 < signs[..., 2][np.abs(seen[..., 2]) > 0.1].mean() < 1.0


def test_one_camera_gets_the_calibration_of_another():
    one = clip().of_setting(ONE)
    (camera,) = faulty(one, "another calibration").cameras
    assert camera.name == one.cameras[0].name
    assert np.array_equal(camera.rotation, clip().cameras[1].rotation)


@pytest.mark.parametrize(
    ("change", "worse"),
    [
        ({"pose_m": 0.079}, False), ({"pose_m": 0.081}, True), ({"place_m": 0.089}, False), ({"place_m": 0.091}, True),
        ({"place_m": np.nan}, False), ({"facing": 0.09}, False), ({"facing": 0.11}, True), ({"speed": 0.71}, False),
        ({"speed": 0.69}, True), ({"speed": 1.21}, True), ({"covered": 0.81}, False), ({"covered": 0.79}, True),
    ],
)  # fmt: skip
def test_a_result_is_worse_from_a_threshold_on(change, worse):
    assert is_worse(replace(CLEAN, **change), CLEAN) is worse


def test_a_small_error_must_also_be_half_as_large_again():
    assert not is_worse(replace(CLEAN, pose_m=0.29), replace(CLEAN, pose_m=0.2))
    assert is_worse(replace(CLEAN, pose_m=0.31), replace(CLEAN, pose_m=0.2))


@pytest.mark.parametrize(
    ("fault", "level", "pose_m", "right"),
    [
        ("gap", TRUSTWORTHY, 0.05, True), ("gap", TRUSTWORTHY, 0.5, False), ("gap", DOUBTFUL, 0.5, True),
        ("gap", NOT_USABLE, 0.05, True), ("gap", REFUSED, None, True), ("gap", FAILED, None, False),
        ("20 % outliers", REFUSED, None, False), ("20 % outliers", DOUBTFUL, 0.5, True),
    ],
)  # fmt: skip
def test_a_verdict_is_judged_by_the_result(fault, level, pose_m, right):
    clean = Outcome(Job("tall walker", ONE), TRUSTWORTHY, "", CLEAN)
    errors = None if pose_m is None else replace(CLEAN, pose_m=pose_m)
    assert is_right(Outcome(Job("tall walker", ONE, fault), level, "", errors), clean) is right


@pytest.mark.slow
def test_a_clean_clip_is_tracked_and_a_height_of_half_is_seen():
    outcomes = [faults.outcome(Job("tall walker", SEVERAL, fault), None) for fault in ("", "height × ½")]
    assert [each.level for each in outcomes] == [TRUSTWORTHY, NOT_USABLE]
    assert outcomes[0].errors.place_m < 0.06
