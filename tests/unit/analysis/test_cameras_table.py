"""The table of estimated cameras: its scenes and scores."""

import numpy as np
import pytest

from analysis.tables import cameras


def test_scenes_show_the_walker_entirely_and_differ():
    first, second = cameras.scenes(2)
    for scene in (first, second):
        pixels = scene.keypoints[..., :2]
        assert (pixels > -20.0).all()
        assert (pixels < np.array(cameras.SIZE) + 20.0).all()
        assert (scene.depth_m > 1.0).all()
    assert first.camera.matrix[0, 0] != second.camera.matrix[0, 0]


def test_noise_has_unit_variance_and_the_correlation_between_frames():
    noise = cameras.correlated(np.random.default_rng(0), (20000, 2))
    assert noise.std() == pytest.approx(1.0, rel=0.05)
    assert np.corrcoef(noise[:-1, 0], noise[1:, 0])[0, 1] == pytest.approx(0.8, abs=0.02)


@pytest.mark.slow
def test_the_table_counts_the_scenes_within_the_interval():
    rows = cameras.table(n_scenes=2).splitlines()
    assert [row.count("of 2") for row in rows[2:]] == [1, 1]
