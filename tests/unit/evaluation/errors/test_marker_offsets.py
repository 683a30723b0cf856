"""Constant offsets of markers from the joints of a moving body are estimated exactly."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import SKELETON, standing, step_of

from workbench.body.kinematics import forward
from workbench.core.frame import Truth
from workbench.evaluation.errors.marker_offsets import ESTIMATED_S, MarkerOffsets

RATE_HZ, N_FRAMES = 30.0, 40
N_ESTIMATED = int(ESTIMATED_S * RATE_HZ) + 1  # frames at 0, 1/30, …, ESTIMATED_S
N_JOINTS = len(SKELETON.names)
OFFSETS = 0.03 * np.random.default_rng(0).standard_normal((N_JOINTS, 3))


def moving_poses():
    """Return poses (F, 25) of a random walk in all parameters."""
    steps = np.random.default_rng(1).standard_normal((N_FRAMES, 25))
    return standing() + 0.1 * steps.cumsum(axis=0)


def markers(poses):
    """Return markers (F, J, 3): the joints plus OFFSETS in the frame of the parent limb; of the root in the world's."""
    frames = forward(SKELETON, poses)
    parents = [0, *SKELETON.parents[1:]]
    return frames.positions + np.einsum("fjab,jb->fja", frames.rotations[:, parents], OFFSETS)


def measured(poses, positions, moving=SKELETON.dof_names):
    """Return the measure after all frames, and the errors of each frame."""
    measure, errors = MarkerOffsets(SKELETON, moving), []
    for t, (pose, markers_m) in enumerate(zip(poses, positions, strict=True)):
        step = step_of(pose[None], Truth(joints=markers_m))
        errors.append(measure.add(replace(step, frame=replace(step.frame, time_s=t / RATE_HZ))))
    return measure, errors


def test_constant_offsets_are_estimated_and_corrected_exactly():
    poses = moving_poses()
    measure, errors = measured(poses, markers(poses))
    np.testing.assert_allclose(measure.offsets[1:], OFFSETS[1:], atol=1e-12)
    assert errors[:N_ESTIMATED] == [{}] * N_ESTIMATED  # the frames of the estimation have no error
    assert [error["mpjpe_abs_marker_corrected_mm"] for error in errors[N_ESTIMATED:]] == pytest.approx(
        [0.0] * (N_FRAMES - N_ESTIMATED), abs=1e-9
    )
    lengths = {
        f"marker_offset_{name}_mm": 1e3 * np.linalg.norm(OFFSETS[j]) for j, name in enumerate(SKELETON.names) if j
    }
    assert measure.lengths_mm == pytest.approx(lengths)
    assert measure.corrected_mm["mpjpe_abs_offset_corrected_mm"] == pytest.approx(0.0, abs=1e-9)


def test_corrected_errors_are_the_deviations_from_the_median_offset():
    poses = np.tile(standing(), (N_FRAMES, 1))
    alternating = markers(poses)
    alternating[::2, 1:] += [0.01, 0.0, 0.0]  # the median lies half-way
    measure, _ = measured(poses, alternating)
    assert measure.corrected_mm == pytest.approx(
        {"mpjpe_abs_offset_corrected_mm": 5.0, "mpjpe_offset_corrected_mm": 5.0}
    )


def test_outliers_in_fewer_than_half_of_the_frames_have_no_influence():
    poses = moving_poses()
    positions = markers(poses)
    outliers = np.random.default_rng(2).permutation(N_ESTIMATED)[: (N_ESTIMATED - 1) // 2]
    positions[outliers] += 5.0
    measure, _ = measured(poses, positions)
    np.testing.assert_allclose(measure.offsets[1:], OFFSETS[1:], atol=1e-12)


def test_a_later_error_of_the_estimate_is_not_corrected():
    poses = moving_poses()
    positions = markers(poses)
    poses[N_ESTIMATED:, 0] += 0.05
    _, errors = measured(poses, positions)
    assert [error["mpjpe_abs_marker_corrected_mm"] for error in errors[N_ESTIMATED:]] == pytest.approx(
        [50.0] * (N_FRAMES - N_ESTIMATED)
    )


def test_a_joint_is_counted_half_a_second_after_its_first_marker():
    poses = moving_poses()
    positions, wrist = markers(poses), SKELETON.joint("left_wrist")
    positions[:10, wrist] = np.nan
    positions[:, SKELETON.joint("neck")] = np.nan
    measure, _ = measured(poses, positions)
    np.testing.assert_allclose(measure.offsets[wrist], OFFSETS[wrist], atol=1e-12)
    assert np.isnan(measure.offsets[SKELETON.joint("neck")]).all()
    assert "marker_offset_neck_mm" not in measure.lengths_mm
    positions[N_ESTIMATED, wrist] += [0.13, 0.0, 0.0]  # not counted yet
    positions[-1, wrist] += [0.13, 0.0, 0.0]  # one of thirteen joints
    _, errors = measured(poses, positions)
    assert errors[N_ESTIMATED]["mpjpe_abs_marker_corrected_mm"] == pytest.approx(0.0, abs=1e-9)
    assert errors[-1]["mpjpe_abs_marker_corrected_mm"] == pytest.approx(10.0)


def test_offsets_are_estimated_for_moving_joints_of_truths_without_pose():
    poses = moving_poses()
    measure, _ = measured(poses, markers(poses), moving=["left_shoulder_flexion", "left_elbow_flexion"])
    assert list(measure.lengths_mm) == ["marker_offset_left_elbow_mm", "marker_offset_left_wrist_mm"]
    pose = standing()
    truth = Truth(pose=pose, joints=forward(SKELETON, pose[None]).positions[0])
    assert MarkerOffsets(SKELETON).add(step_of(pose[None], truth)) == {}
