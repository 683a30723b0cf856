"""OpenSim's coordinates of single movements and by its models' order of rotations, and the written file."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, feet_skeleton, person_skeleton
from workbench.motion.formats.opensim_mot import mot_text, opensim_coordinates, read_mot
from workbench.utils.errors import InputError

SKELETON = person_skeleton(from_height(1.7))
FROM_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def pose(**degrees):
    values = np.zeros((1, 25))
    for name, angle in degrees.items():
        values[0, POSE_NAMES.index(name)] = angle if name in POSE_NAMES[:3] else np.radians(angle)
    return values


@pytest.mark.parametrize(
    ("moved", "coordinate"),
    [
        ({"right_hip_flexion": 30.0}, {"hip_flexion_r": 30.0}),  # the thigh forwards
        ({"left_hip_flexion": 30.0}, {"hip_flexion_l": 30.0}),
        ({"right_hip_abduction": 20.0}, {"hip_adduction_r": -20.0}),  # the thigh outwards
        ({"left_hip_abduction": 20.0}, {"hip_adduction_l": -20.0}),
        ({"right_hip_twist": 15.0}, {"hip_rotation_r": 15.0}),  # the toes inwards
        ({"left_hip_twist": 15.0}, {"hip_rotation_l": 15.0}),
        ({"right_knee_flexion": 60.0}, {"knee_angle_r": 60.0}),
        ({"left_knee_flexion": 60.0}, {"knee_angle_l": 60.0}),
        ({"right_shoulder_flexion": 40.0}, {"arm_flex_r": 40.0}),  # the arm forwards
        ({"left_shoulder_flexion": 170.0}, {"arm_flex_l": 170.0}),
        ({"right_shoulder_abduction": 35.0}, {"arm_add_r": -35.0}),
        ({"left_shoulder_abduction": 120.0}, {"arm_add_l": -120.0}),  # above the shoulder
        ({"right_shoulder_twist": 25.0}, {"arm_rot_r": 25.0}),
        ({"left_shoulder_twist": 25.0}, {"arm_rot_l": 25.0}),
        ({"right_elbow_flexion": 90.0}, {"elbow_flex_r": 90.0}),
        ({"left_elbow_flexion": 90.0}, {"elbow_flex_l": 90.0}),
        ({"root_heading": 50.0}, {"pelvis_rotation": 50.0}),  # to the left
        ({"root_pitch": 10.0}, {"pelvis_tilt": -10.0}),  # forwards
        ({"root_roll": 8.0}, {"pelvis_list": 8.0}),  # the left side up
        ({"root_x": 1.0, "root_y": 2.0, "root_z": 0.9}, {"pelvis_tx": 1.0, "pelvis_tz": -2.0, "pelvis_ty": 0.9}),
    ],
)
def test_a_single_movement_changes_a_single_coordinate(moved, coordinate):
    for name, values in opensim_coordinates(SKELETON, pose(**moved)).items():
        assert values[0] == pytest.approx(coordinate.get(name, 0.0), abs=1e-9), name


def test_ankle_angles_are_positive_in_dorsiflexion():
    skeleton, feet = feet_skeleton(from_height(1.7)), np.pad(pose(left_knee_flexion=20.0), ((0, 0), (0, 2)))
    feet[0, skeleton.dof("left_ankle_flexion")], feet[0, skeleton.dof("right_ankle_flexion")] = np.radians([12.0, -7.0])
    found = opensim_coordinates(skeleton, feet)
    assert found["ankle_angle_l"] == pytest.approx(12.0)
    assert found["ankle_angle_r"] == pytest.approx(-7.0)
    plain = opensim_coordinates(SKELETON, feet[:, :25])
    assert set(found) == {*plain, "ankle_angle_l", "ankle_angle_r"}
    assert all(np.array_equal(found[name], values) for name, values in plain.items())
    columns = parsed(mot_text("walk", skeleton, np.zeros(1), feet, ("left_ankle_flexion",)))
    assert "ankle_angle_r" in columns
    assert "ankle_angle_l" not in columns


def test_positive_angles_move_limbs_forward_and_outward():
    """By positions alone: the knee is in front of the hip, or outside of it, and the ankle is behind the knee."""
    frames = forward(SKELETON, pose(right_hip_flexion=30.0, left_hip_abduction=20.0, left_knee_flexion=40.0))
    hip, knee = (frames.positions[0, SKELETON.joint(f"right_{name}")] for name in ("hip", "knee"))
    assert np.degrees(np.arctan2(knee[0] - hip[0], hip[2] - knee[2])) == pytest.approx(30.0)
    hip, knee, ankle = (frames.positions[0, SKELETON.joint(f"left_{name}")] for name in ("hip", "knee", "ankle"))
    assert np.degrees(np.arctan2(knee[1] - hip[1], hip[2] - knee[2])) == pytest.approx(20.0)
    assert ankle[0] < knee[0]


def rotation(z, x, y):
    return (Rotation.from_euler("Z", z, degrees=True) * Rotation.from_euler("X", x, degrees=True)
            * Rotation.from_euler("Y", y, degrees=True)).as_matrix()  # fmt: skip


@settings(max_examples=30)
@given(st.lists(st.floats(-1.4, 1.4), min_size=25, max_size=25))
def test_the_coordinates_compose_to_the_rotations_of_the_segments(angles):
    poses = np.array([angles])
    coordinates = {name: float(values[0]) for name, values in opensim_coordinates(SKELETON, poses).items()}
    world = FROM_WORLD @ forward(SKELETON, poses).rotations[0] @ FROM_WORLD.T
    pelvis = rotation(coordinates["pelvis_tilt"], coordinates["pelvis_list"], coordinates["pelvis_rotation"])
    np.testing.assert_allclose(pelvis, world[0], atol=1e-9)
    for side, sign in (("right", 1.0), ("left", -1.0)):
        for joint, names in (("hip", ("hip_flexion", "hip_adduction", "hip_rotation")),
                             ("shoulder", ("arm_flex", "arm_add", "arm_rot"))):  # fmt: skip
            flexion, adduction, turn = (coordinates[f"{name}_{side[0]}"] for name in names)
            local = rotation(flexion, sign * adduction, sign * turn)
            np.testing.assert_allclose(pelvis @ local, world[SKELETON.joint(f"{side}_{joint}")], atol=1e-7)


def parsed(text):
    """Return {label: values} as strictly as OpenSim: a header to endheader, labels, and the declared rows."""
    header, body = text.split("endheader\n")
    declared = dict(line.split("=") for line in header.splitlines() if line.count("=") == 1)
    labels, *rows = body.removesuffix("\n").split("\n")
    values = np.array([[float(cell) for cell in row.split("\t")] for row in rows])
    assert values.shape == (int(declared["nRows"]), int(declared["nColumns"]))
    assert declared["inDegrees"] == "yes"
    return dict(zip(labels.split("\t"), values.T, strict=True))


def test_the_file_has_the_frames_with_poses_and_the_determined_coordinates():
    rng = np.random.default_rng(3)
    poses = np.cumsum(rng.uniform(0.0, 0.1, (90, 25)), axis=0)
    poses[:, 6:] = 0.5 * np.sin(poses[:, 6:])
    expected, times_s = opensim_coordinates(SKELETON, poses), np.arange(90) / 29.97
    assert np.abs(np.diff(expected["pelvis_rotation"])).max() < 90.0  # the heading exceeds a full turn
    poses[[4, 7]] = np.nan
    columns = parsed(mot_text("walk", SKELETON, times_s, poses))
    present = np.isfinite(poses[:, 0])
    np.testing.assert_allclose(columns.pop("time"), times_s[present], atol=0.51e-9)
    assert list(columns) == list(expected)
    for name, values in columns.items():
        wrapped = (values - expected[name][present] + 180.0) % 360.0 - 180.0
        np.testing.assert_allclose(wrapped, 0.0, atol=0.51e-8, err_msg=name)
    determined = parsed(mot_text("walk", SKELETON, times_s, poses, ("left_elbow_flexion", "left_shoulder_twist")))
    assert set(columns) - set(determined) == {"elbow_flex_l", "arm_rot_l"}
    assert "pelvis_tilt" not in parsed(mot_text("walk", SKELETON, times_s, poses, ("root_pitch",)))


def test_a_written_file_is_read_back(tmp_path):
    path, times_s = tmp_path / "a.mot", np.arange(4) / 30.0
    poses = np.repeat(pose(right_knee_flexion=60.0, left_hip_flexion=30.0, root_heading=179.0), 4, axis=0)
    poses[2:, 3] = np.radians(181.0)
    path.write_text(mot_text("a", SKELETON, times_s, poses))
    read_s, angles = read_mot(path)
    np.testing.assert_allclose(read_s, times_s, atol=1e-9)
    expected = {
        name: each for name, each in opensim_coordinates(SKELETON, poses).items() if not name.startswith("pelvis_t")
    }
    assert set(angles) == {*expected, "pelvis_tilt"}
    for name, each in expected.items():
        np.testing.assert_allclose(angles[name], each, atol=1e-7)


def test_radians_are_degrees_and_other_columns_are_ignored(tmp_path):
    path = tmp_path / "a.mot"
    path.write_text("a\nversion=1\ninDegrees=no\nendheader\ntime\tpelvis_tx\tknee_angle_r\tbeta\n0\t1\t0.5\t9\n")
    _, angles = read_mot(path)
    assert set(angles) == {"knee_angle_r"}
    assert angles["knee_angle_r"] == pytest.approx(np.degrees([0.5]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time\tknee_angle_r\n0\t1\n", "line 1: expected a motion file of OpenSim"),
        (
            "endheader\ntime\tpelvis_tx\n0\t1\n",
            "line 2: expected joint angles, such as knee_angle_r, found time, pelvis_tx",
        ),
        ("endheader\nknee_angle_r\n0\n", "line 2: expected times, s, that increase, in a first column time"),
        ("endheader\ntime\tknee_angle_r\n0\t1\n0\t1\n", "line 2: expected times, s, that increase"),
        ("endheader\ntime\tknee_angle_r\n0\n", "line 3: expected 2 values for a row, found 1"),
        ("endheader\ntime\tknee_angle_r\n0\t1\n1\tnan\n", "line 4: expected numbers for a row"),
    ],
)
def test_a_damaged_file_is_refused_with_the_line(tmp_path, text, message):
    path = tmp_path / "a.mot"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_mot(path)


@pytest.mark.parametrize(("lowest_deg", "sign"), [(-19.9, 1.0), (-20.1, -1.0)])
def test_knees_that_flex_by_negative_angles_change_their_sign(tmp_path, lowest_deg, sign):
    """No knee hyperextends by 20°; the other angles keep their sign."""
    rows = [f"{t}\t{lowest_deg}\t-3\t-40" for t in (0.0, 0.1)]
    (tmp_path / "a.mot").write_text(
        "\n".join(["a", "endheader", "time\tknee_angle_r\tknee_angle_l\thip_flexion_r", *rows])
    )
    _, angles = read_mot(tmp_path / "a.mot")
    assert [each[0] for each in angles.values()] == [sign * lowest_deg, sign * -3.0, -40.0]
