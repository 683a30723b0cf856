"""A recorded walk retargeted, written for Blender and OpenSim, and read again."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.motion_export import Track, export
from workbench.motion.sources import load_motion


@pytest.fixture(scope="module")
def walk(data):
    return load_motion(data / "cmu" / "35" / "35_02.amc")


def track(motion):
    skeleton, frames = person_skeleton(motion.shape), np.arange(len(motion))
    return Track(skeleton, frames, frames / motion.rate_hz, joints(skeleton, motion.poses), motion.poses)


def test_a_cmu_walk_as_bvh(walk, tmp_path):
    path = tmp_path / "walk.bvh"
    export(path, track(walk))
    clip = read_bvh(path)
    assert (len(clip), clip.rate_hz) == (len(walk), 120.0)
    expected = joints(person_skeleton(walk.shape), walk.poses)
    # Our order is depth first, as the file's is. Six decimals of centimetres: 1e-8 m for each of up to four places in a
    # chain; those of degrees, 1e-8 rad in up to nine turns, add 2e-7 m.
    np.testing.assert_allclose(clip.positions, expected, atol=2.5e-7)
    heights = clip.positions[..., 2]
    assert heights[:, clip.joint("neck_end")].min() > 1.4  # upright, in metres
    assert heights[:, clip.joint("left_knee_end")].max() < 0.5


def test_a_cmu_walk_as_trc(walk, tmp_path):
    path = tmp_path / "walk.trc"
    export(path, track(walk), metres=True)
    lines = path.read_text().split("\n")
    assert lines[2].split("\t") == ["120", "120", str(len(walk)), "15", "m", "120", "1", str(len(walk))]
    assert lines[3].split("\t")[2::3] == list(JOINT_NAMES)
    rows = np.loadtxt(lines[6:])
    assert rows[-1, 1] == pytest.approx((len(walk) - 1) / 120.0)
    places = rows[:, 2:].reshape(-1, 15, 3)
    assert places[:, JOINT_NAMES.index("head_centre"), 1].min() > 1.4  # y is up
    np.testing.assert_allclose(places[..., [2, 0, 1]], joints(person_skeleton(walk.shape), walk.poses), atol=0.51e-7)
