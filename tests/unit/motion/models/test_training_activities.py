"""Activity models by the name of their motions: what is in them, and that the cache gives the same one."""

import numpy as np
import pytest

from workbench.motion.models.training import activity_model, database_motions, training_motions
from workbench.utils.errors import InputError


def test_generated_walks_and_runs_need_no_download(tmp_path):
    found = database_motions("builtin", data=None, cache=str(tmp_path))
    assert [motion.activity for motion in found] == ["walk"] * 12 + ["run"] * 12
    walks = training_motions("builtin", data=None, cache=str(tmp_path), subjects=None)
    assert {motion.activity for motion in walks} == {"walk"}


def test_clips_and_activities_are_left_out(tmp_path):
    without = activity_model(cache=str(tmp_path), leave_out=["runner_03"], most_per_clip=1)
    assert "runner_03_straight" not in without.sources
    assert len(without.sources) == 23
    runs = activity_model(cache=str(tmp_path), activities=["run"], most_per_clip=1)
    assert set(runs.activities) == {"run"}
    assert not np.array_equal(runs.mean, without.mean)
    with pytest.raises(InputError, match="swim"):
        activity_model(cache=str(tmp_path), activities=["swim"])
