"""The weight of a joint's keypoints is the largest inside the image."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import record
from recording_steps import steps

from workbench.body.skeleton import JOINT_NAMES
from workbench.recording.read.keypoints import keypoint_weights


def with_keypoints(keypoints):
    """Yield one step per array of keypoints (15, 3)."""
    for step, points in zip(steps(len(keypoints), n_particles=20), keypoints, strict=True):
        view = replace(step.frame.views[0], keypoints=points)
        yield replace(step, frame=replace(step.frame, views=(view,)))


def test_the_weight_of_a_joint_is_the_largest_inside_the_image(tmp_path):
    """The image is 640 by 480."""
    keypoints = np.full((3, 15, 3), np.nan)
    keypoints[:, 0] = [[10.0, 20.0, 0.25], [11.0, 20.0, 0.9], [12.0, 20.0, 0.5]]
    keypoints[1, 3] = [639.0, 479.0, 0.4]
    keypoints[2, 4] = [-1.0, 20.0, 1.0]
    keypoints[0, 5] = [20.0, 480.5, 1.0]
    weights = keypoint_weights(record(tmp_path / "run.rrd", with_keypoints(keypoints)))
    expected = {JOINT_NAMES[0]: 0.9, JOINT_NAMES[3]: 0.4, JOINT_NAMES[4]: 0.0, JOINT_NAMES[5]: 0.0}
    assert weights == pytest.approx(expected, abs=1e-6)


def test_a_recording_without_keypoints_has_no_weights(tmp_path):
    assert keypoint_weights(record(tmp_path / "run.rrd", with_keypoints([None, None]))) == {}
