"""Points and splices of recorded walks and runs."""

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
def test_recorded_walks_pass_into_runs(data, clips):
    take = find_sequence(Scene(motion=clips, data=str(data), n_frames=28, first_frame=10 if clips[0][0] == "d" else 0))
    assert [truth.activity for truth in take.truths] == ["walk"] * 14 + ["run"] * 14
    speeds = 14.0 * np.linalg.norm(np.diff(take.motion.poses[:, :2], axis=0), axis=1)
    assert np.median(speeds[:10]) < 2.0 < np.median(speeds[-10:])
    # no joint of a runner is faster than 12 m/s, give or take: a foot swings through at twice the body's 5 m/s
    assert 14.0 * np.linalg.norm(np.diff(take.places, axis=0), axis=2).max() < 12.0
    assert np.diff(take.phases).min() > 0.0
    first, last = take.phase_ends
    # 27 frames of 1/14 s, at the 0.8 to 1.6 strides a second of walkers and runners
    assert 27 / 14 * 0.7 < last - first < 27 / 14 * 1.6
