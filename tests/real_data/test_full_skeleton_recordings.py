"""The full skeleton of real recordings: Bandai's and CMU's joints to a micrometre, as smooth as the files."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.full_skeleton import full_poses, full_skeleton

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


def places_of(clip, skeleton):
    return clip.positions[:, [clip.joint(name) for name in skeleton.names]]


@pytest.mark.parametrize("name", CLIPS)
def test_bandai_joints_are_reproduced(bandai, name):
    clip = read_bvh(bandai / f"{name}.bvh")
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    assert poses.shape == (len(clip), 66)
    np.testing.assert_allclose(joints(skeleton, poses), places_of(clip, skeleton), rtol=0.0, atol=1e-6)
    # a fast ankle or toe turns by less than 1000 degrees a second; a change of course or a whole turn is 3 or 6 rad
    assert np.abs(np.diff(poses[:, 3:], axis=0)).max() < np.deg2rad(1000.0) / clip.rate_hz
    # nobody comes near a singular direction, so that angles can be averaged
    middle = poses[:, 7::3]
    assert np.abs(middle).max() < np.deg2rad(80.0)
    assert np.abs(poses[:, 6:].mean(axis=0)).max() < 2.3  # a runner's elbows; no angle has turned right round


def test_all_bandai_clips_have_one_skeleton(bandai):
    first, second = (full_skeleton(read_bvh(bandai / f"{name}.bvh")) for name in (CLIPS[0], CLIPS[4]))
    assert (first.names, first.dof_names) == (second.names, second.dof_names)
    np.testing.assert_array_equal(first.offsets, second.offsets)
    assert len(first.names) == 21
    # this file gives its end sites lengths: joints more, but no degree of freedom
    longer = full_skeleton(read_bvh(bandai / f"{CLIPS[1]}.bvh"))
    assert longer.dof_names == first.dof_names
    assert set(first.names) < set(longer.names)


def test_cmu_joints_are_reproduced(data):
    clip = read_amc(data / "cmu" / "35" / "35_02.amc")
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    assert 60 <= poses.shape[1] <= 90
    np.testing.assert_allclose(joints(skeleton, poses), places_of(clip, skeleton), rtol=0.0, atol=1e-9)
