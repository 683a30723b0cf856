"""What a run comes to: means over the frames that were tracked."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
from single_steps import standing, step_of

from workbench.core.frame import Truth
from workbench.experiment.summary import Summary


def summary_of(*errors):
    """The summary of a run whose frames have these errors, of the n-th of which n particles count."""
    summary = Summary("experiment", 0, Path("run.rrd"))
    for n, values in enumerate(errors, start=1):
        summary.add(step_of(np.tile(standing(), (n, 1)), Truth()), values)
    return summary


def test_the_first_frame_which_is_given_is_left_out_of_the_means():
    metrics = summary_of({"error_abs_mm": 1000.0}, {"error_abs_mm": 30.0}, {"error_abs_mm": 50.0}).metrics
    assert metrics["error_abs_mm"] == pytest.approx(40.0)
    assert metrics["ess_mean"] == pytest.approx(2.5)
    assert metrics["frames"] == 3.0


def test_flexion_is_told_by_its_root_mean_square():
    metrics = summary_of({}, *({"knee_deg": error, "error_angle_deg": error} for error in (3.0, 5.0))).metrics
    assert metrics["knee_deg"] == pytest.approx(np.sqrt(17.0))
    assert metrics["error_angle_deg"] == pytest.approx(4.0)


def test_a_mean_is_over_the_frames_that_have_the_error():
    assert summary_of({}, {"error_px": 4.0}, {}, {"error_px": 8.0}).metrics["error_px"] == pytest.approx(6.0)


def test_how_a_run_ended_is_written_on_a_full_disk(tmp_path, monkeypatch):
    summary, path = summary_of({"error_px": 1.0}), tmp_path / "summary.json"
    summary.write(path)
    summary.over_run = {f"offset_{k}_mm": 1.0 for k in range(200)}  # of which nothing was known when it began

    def refuse(*paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", refuse)
    summary.status, summary.error, summary.provenance = "failed", "OSError: no room", {"difference": "+" * 40_000}
    summary.write(path)
    found = json.loads(path.read_text())
    assert (found["status"], found["error"], found["seed"]) == ("failed", "OSError: no room", summary.seed)
    assert found["metrics"]["frames"] == 1.0
    assert "provenance" not in found
