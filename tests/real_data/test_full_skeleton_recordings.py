"""The full skeleton reproduces the joints of Bandai and CMU recordings, with smooth angles and their flexions."""

import numpy as np
import pytest

from workbench.body.angles import flexions
from workbench.body.kinematics import joints
from workbench.body.skeleton import person_skeleton
from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.full_skeleton import full_poses, full_skeleton
from workbench.motion.sources import find_clip, load_motion, read_clip

CLIPS = [
    *(f"dataset-1/dataset-1_{kind}_001" for kind in ("walk_normal", "run_normal", "run_active", "walk_tired")),
    *(f"dataset-2/dataset-2_{kind}_001" for kind in ("walk_youthful", "run_elderly")),
]


@pytest.fixture(scope="module")
def bandai(data):
    folder = data / "bandai"
    if not folder.is_dir():
        pytest.skip(f"no Bandai recordings in {data}")
    return folder


def positions_of(clip, skeleton):
    return clip.positions[:, [clip.joint(name) for name in skeleton.names]]


@pytest.mark.parametrize("name", CLIPS)
def test_bandai_joints_are_reproduced(bandai, name):
    clip = read_bvh(bandai / f"{name}.bvh")
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    assert poses.shape == (len(clip), 66)
    np.testing.assert_allclose(joints(skeleton, poses), positions_of(clip, skeleton), rtol=0.0, atol=1e-6)
    # ankles and toes rotate by less than 1000 degrees a second; a jump between Euler solutions is 3 or 6 rad
    assert np.abs(np.diff(poses[:, 3:], axis=0)).max() < np.deg2rad(1000.0) / clip.rate_hz
    # no angle is near the singularity of its Euler sequence, so that angles can be averaged
    assert np.abs(poses[:, 7::3]).max() < np.deg2rad(80.0)
    assert np.abs(poses[:, 6:].mean(axis=0)).max() < 2.3  # the elbows of a runner; no angle has a full turn


def test_all_bandai_clips_have_one_skeleton(bandai):
    first, second = (full_skeleton(read_bvh(bandai / f"{name}.bvh")) for name in (CLIPS[0], CLIPS[4]))
    assert (first.names, first.dof_names) == (second.names, second.dof_names)
    np.testing.assert_array_equal(first.offsets, second.offsets)
    assert len(first.names) == 21
    # end sites of nonzero length in this file are joints without degrees of freedom
    longer = full_skeleton(read_bvh(bandai / f"{CLIPS[1]}.bvh"))
    assert longer.dof_names == first.dof_names
    assert set(first.names) < set(longer.names)


def test_cmu_joints_are_reproduced(data):
    clip = read_amc(data / "cmu" / "35" / "35_02.amc")
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    assert 60 <= poses.shape[1] <= 90
    np.testing.assert_allclose(joints(skeleton, poses), positions_of(clip, skeleton), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["dataset-2_walk_normal_001", "35_02"])
def test_flexions_agree_with_the_retargeted_person(data, name):
    path = find_clip(data, name)
    clip, motion = read_clip(path), load_motion(path)
    skeleton, person = full_skeleton(clip), person_skeleton(motion.shape)
    poses, frames = full_poses(clip), np.arange(0, len(clip), 8)
    for flexion in ("left_hip", "right_hip", "left_knee", "right_knee"):
        full = np.array([flexions(skeleton, poses[i])[flexion] for i in frames])
        retargeted = np.array([flexions(person, motion.poses[i])[flexion] for i in frames])
        # retargeting moves the ends of a bone of 0.4 m by up to 1 cm; the zero of the hip is another one
        assert np.std(full - retargeted) < 3.0
        assert np.ptp(retargeted) > 30.0
