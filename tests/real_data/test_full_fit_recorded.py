"""Every joint of recorded people: the flexion their files tell, and a fit in paper D's own setting."""

import numpy as np
import pytest

from workbench.body.angles import flexions
from workbench.body.skeleton import person_skeleton
from workbench.motion.full_skeleton import full_poses, full_skeleton
from workbench.motion.sources import find_clip, load_motion, read_clip

HELD_OUT = "dataset-2_walk_normal_001"


@pytest.mark.parametrize("name", [HELD_OUT, "35_02"])
def test_full_skeletons_flex_as_the_retargeted_person(data, name):
    path = find_clip(data, name)
    clip, motion = read_clip(path), load_motion(path)
    skeleton, person = full_skeleton(clip), person_skeleton(motion.shape)
    full, every = full_poses(clip), np.arange(0, len(clip), 8)
    for flexion in ("left_hip", "right_hip", "left_knee", "right_knee"):
        found = np.array([flexions(skeleton, full[i])[flexion] for i in every])
        expected = np.array([flexions(person, motion.poses[i])[flexion] for i in every])
        # retargeting moves the ends of a bone of 0.4 m by up to 1 cm each, and a hip's zero is another
        assert np.std(found - expected) < 3.0
        assert np.ptp(expected) > 30.0
