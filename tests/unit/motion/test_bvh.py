"""Written BVH files: their channels and frame times, and their joints by our reader and by bvhio."""

import tempfile
from dataclasses import replace
from pathlib import Path

import bvhio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from valid_files import BVH

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import FOOT_POINTS, POSE_NAMES, feet_skeleton, person_skeleton
from workbench.motion.formats.bvh import bvh_text, read_bvh

SKELETON = person_skeleton(from_height(1.8))
LEAVES = {"head_centre": "neck_end", **{f"{side}_{leaf}": f"{side}_{parent}_end" for side in ("left", "right")
          for leaf, parent in (("wrist", "elbow"), ("ankle", "knee"))}}  # fmt: skip
"""The names in a file of the joints without children."""


def pose(**values):
    numbers = np.zeros(25)
    for name, value in values.items():
        numbers[POSE_NAMES.index(name)] = value
    return numbers


def random_poses(n, seed=3):
    rng = np.random.default_rng(seed)
    return np.hstack([rng.uniform(-3.0, 3.0, (n, 3)), rng.uniform(-np.pi, np.pi, (n, 22))])


def channels(text):
    """Return {(joint, channel): values (F,)} of the text of a BVH file."""
    hierarchy, motion = text.split("MOTION")
    names, joint = [], ""
    for words in map(str.split, hierarchy.splitlines()):
        if words[0] in ("ROOT", "JOINT"):
            joint = words[1]
        if words[0] == "CHANNELS":
            assert int(words[1]) == len(words) - 2
            names += [(joint, word) for word in words[2:]]
    rows = np.array([row.split() for row in motion.splitlines()[3:]], dtype=float)
    return dict(zip(names, rows.T, strict=True))


def test_bvhio_reads_the_same_joints(tmp_path):
    """bvhio, a package on PyPI, computes kinematics independently."""
    poses = random_poses(6)
    path = tmp_path / "out.bvh"
    path.write_text(bvh_text(SKELETON, poses, 30.0))
    root = bvhio.readAsHierarchy(str(path))
    ends = {joint.Name: np.linalg.norm(joint.EndSite) for joint, _, _ in bvhio.readAsBvh(str(path)).Root.layout()}
    for frame, expected in enumerate(100.0 * joints(SKELETON, poses)[..., [1, 2, 0]]):
        root.loadPose(frame)
        read = {}
        for joint, _, _ in root.layout():
            read[joint.Name] = np.array(joint.PositionWorld)
            # bvhio turns a joint's frame so that y points along its bone, for a leaf to the End Site
            read[f"{joint.Name}_end"] = read[joint.Name] + ends[joint.Name] * np.array(joint.UpWorld)
        positions = np.array([read[LEAVES.get(name, name)] for name in SKELETON.names])
        np.testing.assert_allclose(positions, expected, atol=0.01)  # cm, in float32


def test_feet_are_read_back_by_bvhio_and_by_our_reader(tmp_path):
    """Heel and toes are joints, which the ankle's angle moves."""
    poses = np.hstack([random_poses(4), np.random.default_rng(1).uniform(-0.9, 0.5, (4, 2))])
    skeleton, path = feet_skeleton(from_height(1.8)), tmp_path / "out.bvh"
    path.write_text(bvh_text(skeleton, poses, 30.0))
    expected, ends = joints(skeleton, poses), [skeleton.joint(name) for name in FOOT_POINTS]
    clip = read_bvh(path, unit="cm", up="y")
    np.testing.assert_allclose(
        clip.positions[:, [clip.joint(name) for name in FOOT_POINTS]], expected[:, ends], atol=1e-6
    )
    root = bvhio.readAsHierarchy(str(path))
    for frame in range(len(poses)):
        root.loadPose(frame)
        read = {joint.Name: np.array(joint.PositionWorld) for joint, _, _ in root.layout()}
        found = np.array([read[name] for name in FOOT_POINTS])
        np.testing.assert_allclose(found, 100.0 * expected[frame, ends][:, [1, 2, 0]], atol=0.01)  # cm, in float32


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 29.97, 14.0])
def test_the_frame_rate_is_read_back(tmp_path, rate_hz):
    path = tmp_path / "out.bvh"
    path.write_text(bvh_text(SKELETON, np.zeros((3, 25)), rate_hz))
    clip = read_bvh(path)
    assert len(clip) == 3
    assert clip.rate_hz == pytest.approx(rate_hz, rel=0.5e-9 * rate_hz)  # the frame time has nine decimals
    assert clip.rate_hz == rate_hz or rate_hz == 29.97


def test_written_angles_are_continuous():
    turns = np.stack([pose(root_heading=angle, left_shoulder_flexion=angle) for angle in np.linspace(0.0, 12.0, 60)])
    values = channels(bvh_text(SKELETON, turns, 30.0))
    steps = np.diff(values["pelvis", "Yrotation"]), -np.diff(values["left_shoulder", "Xrotation"])
    np.testing.assert_allclose(steps, np.rad2deg(12.0 / 59), atol=1e-6)


def test_axes_that_bvh_lacks_are_rejected():
    oblique, repeated = SKELETON.dof_axes.copy(), SKELETON.dof_axes.copy()
    oblique[SKELETON.dof("left_knee_flexion")] = (0.6, 0.8, 0.0)
    repeated[SKELETON.dof("left_hip_twist")] = (0.0, 1.0, 0.0)
    for axes, joint in ((oblique, "left_knee"), (repeated, "left_hip")):
        with pytest.raises(ValueError, match=joint):
            bvh_text(replace(SKELETON, dof_axes=axes), np.zeros((1, 25)), 30.0)


@pytest.mark.parametrize(
    ("frame_time", "rate_hz"),
    [("0.0333333", 30.0), ("0.033333", 30.0), ("0.0333", 30.0), ("3.33333e-02", 30.0), ("0.00833333", 120.0),
     ("0.033367", 1 / 0.033367), ("0.04", 25.0), ("0.5", 2.0), ("2.5", 0.4)],
)  # fmt: skip
def test_a_rounded_frame_time_gives_the_exact_rate(tmp_path, frame_time, rate_hz):
    (tmp_path / "r.bvh").write_text(BVH.replace("0.0333333", frame_time))
    assert read_bvh(tmp_path / "r.bvh").rate_hz == pytest.approx(rate_hz, rel=1e-12)


singular = st.sampled_from([0.0, -0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-9])
angle = st.one_of(st.floats(-7.0, 7.0), singular)
coordinate = st.floats(-100.0, 100.0)


@settings(max_examples=30)
@given(
    position=st.tuples(coordinate, coordinate, coordinate),
    angles=st.lists(angle, min_size=22, max_size=22),
    height_m=st.floats(0.5, 2.5),
    unit=st.sampled_from(["cm", "m"]),
)
def test_a_bvh_file_has_the_joints_of_the_pose(position, angles, height_m, unit):
    skeleton = person_skeleton(from_height(height_m))
    poses = np.array([[*position, *angles]])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.bvh"
        path.write_text(bvh_text(skeleton, poses, 30.0, unit))
        clip = read_bvh(path, unit, "y")
    # The depth-first order of the file is the skeleton's order. Six decimals of metres are 0.87e-6 m for each of up to
    # four joints of a chain; those of degrees, 1e-8 rad in up to nine turns, add 2e-7 m.
    np.testing.assert_allclose(clip.positions[0], joints(skeleton, poses)[0], atol=4e-6)
