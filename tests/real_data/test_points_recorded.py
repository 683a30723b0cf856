"""Concatenated recordings of walks and runs."""

import numpy as np
import pytest

from workbench.datasets.rendering.sequence import Scene, find_sequence


@pytest.mark.parametrize(
    "clips",
    [
        ["35_02", "02_03"],
        ["dataset-2_walk_normal_001", "dataset-2_run_normal_001"],
        ["07_01", "dataset-2_run_active_001"],
    ],
)
def test_a_recorded_walk_is_concatenated_with_a_run(data, clips):
    sequence = find_sequence(
        Scene(motion=clips, data=str(data), n_frames=28, first_frame=10 if clips[0][0] == "d" else 0)
    )
    assert [truth.activity for truth in sequence.truths] == ["walk"] * 14 + ["run"] * 14
    speeds = 14.0 * np.linalg.norm(np.diff(sequence.motion.poses[:, :2], axis=0), axis=1)
    assert np.median(speeds[:10]) < 2.0 < np.median(speeds[-10:])
    # a swinging foot moves at twice the speed of the body, 5 m/s
    assert 14.0 * np.linalg.norm(np.diff(sequence.places, axis=0), axis=2).max() < 12.0
    assert np.diff(sequence.phases).min() > 0.0
    first, last = sequence.phase_ends
    # 27 frames of 1/14 s at 0.8 to 1.6 strides a second
    assert 27 / 14 * 0.7 < last - first < 27 / 14 * 1.6
