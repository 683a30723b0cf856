"""Reported angles agree with OpenSim's, with rotations of the body, and with generated cycles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from walking_scenes import scene

from workbench.body.kinematics import forward
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.evaluation.gait.angle_cycles import N_POINTS
from workbench.evaluation.gait.joint_angles import CONVENTIONS, joint_angles
from workbench.motion.formats.opensim_mot import opensim_coordinates
from workbench.motion.synthetic.gait import average_subject, walker

SKELETON = person_skeleton(from_height(1.75))
POSES = np.random.default_rng(0).uniform(-0.5, 0.7, (50, len(POSE_NAMES)))
ANGLES = joint_angles(POSE_NAMES, POSES)


def column(name, side):
    return next(k for k, each in enumerate(zip(ANGLES.names, ANGLES.sides, strict=True)) if each == (name, side))


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("name", "opensim"),
    [
        ("hip_flexion", "hip_flexion"), ("hip_adduction", "hip_adduction"), ("hip_rotation", "hip_rotation"),
        ("knee_flexion", "knee_angle"), ("shoulder_flexion", "arm_flex"), ("elbow_flexion", "elbow_flex"),
    ],
)  # fmt: skip
def test_angles_of_limbs_are_opensims(name, opensim, side):
    expected = opensim_coordinates(SKELETON, POSES)[f"{opensim}_{side[0]}"]
    np.testing.assert_allclose(np.degrees(ANGLES.values[:, column(name, side)]), expected, atol=1e-6)


def test_the_torso_is_rotated_listed_and_tilted_in_this_order():
    tilt, obliquity, rotation = (ANGLES.values[:, column(f"torso_{k}", "both")] for k in ("tilt", "list", "rotation"))
    made = Rotation.from_euler("ZXY", np.stack([rotation, obliquity, -tilt], axis=1)).as_matrix()
    np.testing.assert_allclose(made, forward(SKELETON, POSES).rotations[:, 0], atol=1e-12)


def test_tilt_and_list_have_opensims_signs():
    pose = np.zeros((2, len(POSE_NAMES)))
    pose[0, POSE_NAMES.index("root_pitch")] = pose[1, POSE_NAMES.index("root_roll")] = 0.2
    coordinates = opensim_coordinates(SKELETON, pose)
    tilt, obliquity = (joint_angles(POSE_NAMES, pose).values[:, column(f"torso_{k}", "both")] for k in ("tilt", "list"))
    np.testing.assert_allclose(np.degrees(tilt), coordinates["pelvis_tilt"], atol=1e-6)
    np.testing.assert_allclose(np.degrees(obliquity), coordinates["pelvis_list"], atol=1e-6)


def test_elevation_is_the_angle_of_upper_arm_and_torso():
    frames = forward(SKELETON, POSES)
    joint = SKELETON.joint
    arm = frames.positions[:, joint("left_elbow")] - frames.positions[:, joint("left_shoulder")]
    down = -frames.rotations[:, 0, :, 2]
    expected = np.arccos((arm * down).sum(axis=1) / np.linalg.norm(arm, axis=1))
    np.testing.assert_allclose(ANGLES.values[:, column("shoulder_elevation", "left")], expected, atol=1e-9)


def test_a_body_with_ankles_has_their_flexion():
    assert "ankle_flexion" not in ANGLES.names
    names = (*POSE_NAMES, "left_ankle_flexion", "right_ankle_flexion")
    angles = joint_angles(names, np.column_stack([POSES, POSES[:, :2]]))
    np.testing.assert_array_equal(angles.values[:, -1], POSES[:, 1])
    assert angles.names[-1] == "ankle_flexion"
    assert set(angles.names) == set(CONVENTIONS)


def test_cycles_of_a_walk_are_its_curves():
    person = average_subject()
    walk = scene(walker(person, 8.0, 60.0)).walk()
    phases = np.linspace(0.0, 1.0, N_POINTS)
    curves = joint_angles(POSE_NAMES, np.column_stack([np.zeros((N_POINTS, 3)), person.angles(phases)]))
    for foot, side in enumerate(("left", "right")):
        cycles = walk.cycles[foot]
        assert cycles.strides.shape[1:] == (N_POINTS, len(ANGLES.names))
        for name in ("hip_flexion", "knee_flexion"):
            k = column(name, side)
            expected = curves.values[:, column(name, "left")]
            # strikes may be 17 ms from the walk's, in which a knee turns by 7°
            np.testing.assert_allclose(np.degrees(cycles.means[0, :, k]), np.degrees(expected), atol=7.0)
            assert np.degrees(cycles.ranges[0, k]) == pytest.approx(np.degrees(np.ptp(expected)), abs=1.0)
            assert np.degrees(cycles.maxima[0, k]) == pytest.approx(np.degrees(expected.max()), abs=1.0)


def test_rotation_is_relative_to_the_direction_of_the_walk():
    circle = scene(walker(average_subject(), 8.0, 30.0, "circle")).walk()
    rotation = np.degrees(circle.cycles[0].means[0, :, column("torso_rotation", "both")])
    assert np.abs(rotation).max() < 30.0  # it turns by 37° in a stride
    assert abs(rotation.mean()) < 12.0
