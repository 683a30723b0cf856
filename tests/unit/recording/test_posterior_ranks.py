"""The rank histogram of a run in its recording."""

from dataclasses import replace

import numpy as np
import pytest
from layouts import SHOWN, laid_out
from recording_steps import BODY, SPACE, steps
from rerun.chunk import RrdReader

from workbench.evaluation.posterior_calibration import ranks, share_below
from workbench.evaluation.step_calibration import pose_ranks
from workbench.recording.write.posterior import RANKS as PATH
from workbench.recording.write.recorder import Recorder


def bars(path, entity):
    """Heights of a bar chart that is logged static."""
    for chunk in RrdReader(path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if "BarChart:values" in batch.schema.names and (values := batch.column("BarChart:values").to_pylist()):
            return np.array(values[-1][0]["buffer"] if isinstance(values[-1][0], dict) else values[-1])
    return None


def record(path, run):
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in run:
            recorder.log(replace(step, warnings=()), {})
    return path


def test_the_shares_of_all_ranks_after_the_first_frame_are_recorded(tmp_path):
    run = list(steps(6))
    found = bars(record(tmp_path / "run.rrd", run), f"/{PATH}")
    every = np.concatenate(
        [
            ranks(share_below(s.poses, np.exp(s.log_weights), s.frame.truth.pose))[np.ptp(s.poses, axis=0) > 0.0]
            for s in run[1:]
        ]
    )
    assert len(every) >= 5
    expected = np.histogram(every, bins=10, range=(0.0, 1.0))[0] / len(every)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert bars(tmp_path / "run.rrd", f"/{PATH}/even") == pytest.approx(np.full(10, 0.1))


def test_without_truth_there_is_none(tmp_path):
    run = [replace(step, frame=replace(step.frame, truth=None)) for step in steps(3)]
    assert all(len(pose_ranks(step)) == 0 for step in run)
    assert bars(record(tmp_path / "run.rrd", run), f"/{PATH}") is None


def test_it_has_a_place_where_the_true_pose_is_known():
    origins = [view.origin for view in laid_out(SHOWN).values()]
    assert f"/{PATH}" not in origins
    known = replace(SHOWN, metrics=(*SHOWN.metrics, "log_score"))
    assert f"/{PATH}" in [view.origin for view in laid_out(known).values()]
