"""The CMU and Bandai recordings are read and retargeted with small errors and plausible angles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import joints
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.retarget import BANDAI, CMU, joint_targets, retarget
from workbench.motion.sources import cmu_clips, load_motion

TRAINING = ("02", "05", "06", "07", "08", "16", "32", "39")


@pytest.fixture(scope="session")
def bandai(data):
    folder = data / "bandai"
    if not folder.is_dir():
        pytest.skip(f"no Bandai recordings in {data}")
    return folder


def test_cmu_walks_are_retargeted_with_small_errors(data):
    errors = np.array([load_motion(path).joint_error_mm for path in cmu_clips(data, TRAINING)[::4]])
    # the analytic solution has mean errors of 5 to 15 mm, up to 26 mm at the arms
    assert errors.mean(axis=1).max() < 15.0
    assert errors.mean(axis=0).max() < 26.0


@pytest.mark.parametrize("name", ["dataset-1/dataset-1_walk_normal_001", "dataset-1/dataset-1_run_active_001",
                                  "dataset-2/dataset-2_walk_youthful_001"])  # fmt: skip
def test_bandai_clips_are_retargeted(bandai, name):
    motion = load_motion(bandai / f"{name}.bvh")
    assert motion.subject == f"bandai-{name[8]}"
    assert motion.activity == name.split("_")[1]
    assert motion.licence == "Bandai Namco Research Motiondataset, CC BY-NC 4.0"
    assert motion.source == f"{name}.bvh"
    assert motion.joint_error_mm.mean() < 15.0
    neck = motion.poses[:, [POSE_NAMES.index(f"neck_{angle}") for angle in ("turn", "nod", "tilt")]]
    assert np.abs(neck.mean(axis=0)).max() < 0.5  # the head is upright and points forwards
    assert 0.1 < motion.shape.head[2] < 0.2  # its centre is above the neck
    knees = motion.poses[:, [POSE_NAMES.index(f"{side}_knee_flexion") for side in ("left", "right")]]
    assert knees.min() > -0.1
    assert knees.max() > 0.8  # the knee of a swinging leg flexes by 60 degrees


def test_the_reported_errors_are_those_of_the_poses(data):
    clip = read_amc(data / "cmu" / "38" / "38_02.amc")
    motion = retarget(clip)
    positions = joints(person_skeleton(motion.shape), motion.poses)
    for name, error in zip(ERROR_JOINTS, motion.joint_error_mm, strict=True):
        target = joint_targets(clip, CMU)[:, JOINT_NAMES.index(name)]
        distance = np.linalg.norm(positions[:, JOINT_NAMES.index(name)] - target, axis=1)
        assert error == pytest.approx(1000 * distance.mean(), rel=1e-9)


@pytest.mark.parametrize(("joint", "ball"), [("tibia", "hip"), ("radius", "shoulder")])
@pytest.mark.parametrize("side", ["left", "right"])
def test_the_hinge_axes_of_the_cmu_table_are_those_of_the_files(data, joint, ball, side):
    clip = read_amc(data / "cmu" / "35" / "35_02.amc")
    bends = Rotation.from_matrix(clip.rotations[:, clip.joint(side[0] + joint)]).as_rotvec()
    sign = 1.0 if joint == "tibia" else -1.0  # knees flex about the person's left, elbows about the right
    hinge = sign * np.array(CMU.lefts[f"{side}_{ball}"])
    assert np.all(bends @ hinge > 0.0)
    # a pure hinge, to the digits of the axes in the file
    np.testing.assert_allclose(bends, np.outer(bends @ hinge, hinge), atol=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_hinge_axes_of_the_bandai_table_are_those_of_the_knees(bandai, side):
    clip = read_bvh(bandai / "dataset-1" / "dataset-1_walk_normal_001.bvh")
    bends = Rotation.from_matrix(clip.rotations[:, clip.joint(f"LowerLeg_{side[0].upper()}")]).as_rotvec()
    flexion = bends @ np.array(BANDAI.lefts[f"{side}_hip"])
    assert flexion.min() > -0.01
    assert flexion.max() > 0.8  # the knee of a swinging leg flexes by 60 degrees
    sideways = np.linalg.norm(bends - np.outer(flexion, BANDAI.lefts[f"{side}_hip"]), axis=1)
    assert sideways.max() < np.deg2rad(2.0)  # the knees are not exactly hinges
