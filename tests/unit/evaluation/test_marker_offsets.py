"""Markers planted beside the joints of a moving body are found where they were planted."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import SKELETON, standing, step_of

from workbench.body.kinematics import forward
from workbench.core.frame import Truth
from workbench.evaluation.marker_offsets import ESTIMATED_S, MarkerOffsets

RATE_HZ, N_FRAMES = 30.0, 40
N_ESTIMATED = int(ESTIMATED_S * RATE_HZ) + 1  # frames at 0, 1/30, … up to and with ESTIMATED_S
N_JOINTS = len(SKELETON.names)
PLANTED = 0.03 * np.random.default_rng(0).standard_normal((N_JOINTS, 3))


def moving_poses():
    """(F, 25): somebody who turns, walks off and moves every joint."""
    steps = np.random.default_rng(1).standard_normal((N_FRAMES, 25))
    return standing() + 0.1 * steps.cumsum(axis=0)


def markers(poses):
    """(F, J, 3): the joints, moved by PLANTED in the frame of the limb above each; the root in the world's."""
    frames = forward(SKELETON, poses)
    above = [0, *SKELETON.parents[1:]]
    return frames.positions + np.einsum("fjab,jb->fja", frames.rotations[:, above], PLANTED)


def measured(poses, places, moving=SKELETON.dof_names):
    """The measure after all frames, and what it told in each."""
    measure, told = MarkerOffsets(SKELETON, moving), []
    for t, (pose, place) in enumerate(zip(poses, places, strict=True)):
        step = step_of(pose[None], Truth(joints=place))
        told.append(measure.add(replace(step, frame=replace(step.frame, time_s=t / RATE_HZ))))
    return measure, told


def test_planted_offsets_are_found_and_leave_no_error():
    poses = moving_poses()
    measure, told = measured(poses, markers(poses))
    np.testing.assert_allclose(measure.offsets[1:], PLANTED[1:], atol=1e-12)
    assert told[:N_ESTIMATED] == [{}] * N_ESTIMATED  # what they are estimated from is not counted
    assert [error["mpjpe_abs_marker_corrected_mm"] for error in told[N_ESTIMATED:]] == pytest.approx(
        [0.0] * (N_FRAMES - N_ESTIMATED), abs=1e-9
    )
    lengths = {
        f"marker_offset_{name}_mm": 1e3 * np.linalg.norm(PLANTED[j]) for j, name in enumerate(SKELETON.names) if j
    }
    assert measure.lengths_mm == pytest.approx(lengths)
    assert measure.corrected_mm["mpjpe_abs_offset_corrected_mm"] == pytest.approx(0.0, abs=1e-9)


def test_what_is_left_without_offsets_is_what_changes():
    poses = np.tile(standing(), (N_FRAMES, 1))
    shaken = markers(poses)
    shaken[::2, 1:] += [0.01, 0.0, 0.0]  # so that the medians lie half-way, as half of the frames do either
    measure, _ = measured(poses, shaken)
    assert measure.corrected_mm == pytest.approx(
        {"mpjpe_abs_offset_corrected_mm": 5.0, "mpjpe_offset_corrected_mm": 5.0}
    )


def test_outliers_in_fewer_than_half_of_the_frames_do_not_matter():
    poses = moving_poses()
    places = markers(poses)
    wrong = np.random.default_rng(2).permutation(N_ESTIMATED)[: (N_ESTIMATED - 1) // 2]
    places[wrong] += 5.0
    measure, _ = measured(poses, places)
    np.testing.assert_allclose(measure.offsets[1:], PLANTED[1:], atol=1e-12)


def test_an_estimate_that_goes_astray_later_is_told():
    poses = moving_poses()
    places = markers(poses)
    poses[N_ESTIMATED:, 0] += 0.05
    _, told = measured(poses, places)
    assert [error["mpjpe_abs_marker_corrected_mm"] for error in told[N_ESTIMATED:]] == pytest.approx(
        [50.0] * (N_FRAMES - N_ESTIMATED)
    )


def test_a_joint_is_counted_half_a_second_after_it_is_first_known():
    poses = moving_poses()
    places, wrist = markers(poses), SKELETON.joint("left_wrist")
    places[:10, wrist] = np.nan
    places[:, SKELETON.joint("neck")] = np.nan
    measure, told = measured(poses, places)
    np.testing.assert_allclose(measure.offsets[wrist], PLANTED[wrist], atol=1e-12)
    assert np.isnan(measure.offsets[SKELETON.joint("neck")]).all()
    assert "marker_offset_neck_mm" not in measure.lengths_mm
    astray = places.copy()  # the wrist alone is off, where it is not counted yet and where it is one of thirteen
    astray[N_ESTIMATED, wrist] += [0.13, 0.0, 0.0]
    astray[-1, wrist] += [0.13, 0.0, 0.0]
    _, told = measured(poses, astray)
    assert told[N_ESTIMATED]["mpjpe_abs_marker_corrected_mm"] == pytest.approx(0.0, abs=1e-9)
    assert told[-1]["mpjpe_abs_marker_corrected_mm"] == pytest.approx(10.0)


def test_an_arm_is_measured_alone_and_a_true_pose_has_no_markers():
    poses = moving_poses()
    measure, _ = measured(poses, markers(poses), moving=["left_shoulder_flexion", "left_elbow_flexion"])
    assert list(measure.lengths_mm) == ["marker_offset_left_elbow_mm", "marker_offset_left_wrist_mm"]
    pose = standing()
    exact = Truth(pose=pose, joints=forward(SKELETON, pose[None]).positions[0])
    assert MarkerOffsets(SKELETON).add(step_of(pose[None], exact)) == {}
