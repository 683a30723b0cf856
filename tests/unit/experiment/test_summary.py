"""The summary of a run, and its folder: locked, complete after any interruption, and never overwritten."""

import errno
import json
import logging
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from single_steps import standing, step_of

from workbench.core.frame import Truth
from workbench.experiment import run as run_module
from workbench.experiment import summary as summary_module
from workbench.experiment.run import ending
from workbench.experiment.summary import Summary, set_aside
from workbench.recording.read.reader import read
from workbench.recording.write import file as files
from workbench.recording.write.file import RecordingFile
from workbench.results.table import read_run
from workbench.utils import signals
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import is_locked, run_folder
from workbench.utils.signals import Interrupted, interruptible


def summary_of(*errors):
    """Return the summary of a run whose n-th frame has these errors and n equally weighted particles."""
    summary = Summary("experiment", 0, Path("run.rrd"))
    for n, values in enumerate(errors, start=1):
        summary.add(step_of(np.tile(standing(), (n, 1)), Truth()), values)
    return summary


def test_means_omit_the_first_frame():
    metrics = summary_of({"mpjpe_abs_mm": 1000.0}, {"mpjpe_abs_mm": 30.0}, {"mpjpe_abs_mm": 50.0}).metrics
    assert metrics["mpjpe_abs_mm"] == pytest.approx(40.0)
    assert metrics["ess_mean"] == pytest.approx(2.5)
    assert metrics["n_frames"] == 3.0


def test_flexion_is_summarized_by_its_root_mean_square():
    metrics = summary_of(
        {}, *({"knee_flexion_rmse_deg": error, "mpjae_local_deg": error} for error in (3.0, 5.0))
    ).metrics
    assert metrics["knee_flexion_rmse_deg"] == pytest.approx(np.sqrt(17.0))
    assert metrics["mpjae_local_deg"] == pytest.approx(4.0)


def test_a_mean_is_over_the_frames_with_the_error():
    assert summary_of({}, {"mpjpe_px": 4.0}, {}, {"mpjpe_px": 8.0}).metrics["mpjpe_px"] == pytest.approx(6.0)


def test_the_final_status_is_written_on_a_full_disk(tmp_path, monkeypatch):
    summary, path = summary_of({"mpjpe_px": 1.0}), tmp_path / "summary.json"
    summary.write(path)
    summary.run_metrics = {f"marker_offset_{k}_mm": 1.0 for k in range(200)}  # longer than the first summary

    def full_disk(*paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full_disk)
    summary.status, summary.error, summary.provenance = "failed", "OSError: no room", {"difference": "+" * 40_000}
    summary.write(path)
    contents = json.loads(path.read_text())
    assert (contents["status"], contents["error"], contents["seed"]) == ("failed", "OSError: no room", summary.seed)
    assert contents["metrics"]["n_frames"] == 1.0
    assert "provenance" not in contents


def test_a_folder_is_created_and_locked_for_one_run(tmp_path):
    folder = tmp_path / "new" / "run"
    with run_folder(folder):
        assert is_locked(folder)
        with pytest.raises(InputError, match="uses this folder"), run_folder(folder):
            pass
    assert not is_locked(folder)


def test_a_complete_run_is_moved_and_reported(tmp_path, caplog):
    for k in (1, 2):
        (tmp_path / "run.rrd").write_text(f"run {k}")
        (tmp_path / "summary.json").write_text(f"summary {k}")
        with caplog.at_level(logging.WARNING):
            set_aside(tmp_path)
        assert not (tmp_path / "run.rrd").exists()
        assert not (tmp_path / "summary.json").exists()
        moved = tmp_path / EARLIER / str(k)
        assert caplog.messages[-1] == f"{tmp_path}: the complete run in it was moved to {moved}"
        assert [(moved / name).read_text() for name in ("run.rrd", "summary.json")] == [f"run {k}", f"summary {k}"]


def test_the_part_of_a_killed_run_is_not_moved(tmp_path, caplog):
    (tmp_path / "run.rrd.part").write_text("a part")
    set_aside(tmp_path)
    assert not caplog.messages
    assert not (tmp_path / EARLIER).exists()


def test_a_folder_that_cannot_be_created_is_rejected(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "subfolder", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="the folder cannot be created: "), run_folder(place):
            pass


STEPS = [module.__file__ for module in (files, run_module, summary_module, signals)]


def publish(folder, at=None):
    """Publish an empty run, raise a signal at the first visit of line number `at`, and return the number of lines."""
    run, reached = Summary("walk", 0, folder / "run.rrd"), set()

    def step(frame, event, _):
        if frame.f_code.co_filename not in STEPS or frame.f_code.co_name in ("metrics", "cost", "handle"):
            return None
        before = len(reached)
        reached.add((frame, frame.f_lineno))
        if event == "line" and len(reached) > before and len(reached) == at:
            sys.settrace(None)
            signal.raise_signal(signal.SIGTERM)
        return step

    with interruptible():
        try:
            with ending(run), RecordingFile(run.recording, run_id="a", config_yaml="seed: 0", provenance={"seed": 0}):
                sys.settrace(step)
        except Interrupted:
            pass
        finally:
            sys.settrace(None)
    return len(reached)


@pytest.mark.slow
def test_recording_and_summary_agree_when_a_signal_arrives_at_any_line(tmp_path):
    statuses = set()
    for at in range(1, publish(tmp_path / "complete") + 1):
        folder = tmp_path / str(at)
        publish(folder, at)
        status = json.loads((folder / "summary.json").read_text())["status"]
        published = (folder / "run.rrd").is_file()
        recorded = read(folder / ("run.rrd" if published else "run.rrd.part")).status
        assert (status, recorded) in (
            [("complete", "complete")] if published else [("interrupted", "interrupted"), ("interrupted", "running")]
        ), at
        statuses.add(status)
    assert statuses == {"complete", "interrupted"}


def test_a_run_killed_after_publication_is_complete(tmp_path):
    with ending(Summary("walk", 0, tmp_path / "run.rrd")):
        running = (tmp_path / "summary.json").read_bytes()
        with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}) as file:
            file.send_numbers("metrics", {"mpjpe_abs_mm": 2.5})
    (tmp_path / "summary.json").write_bytes(running)  # of a process that has ended
    record = read_run(tmp_path)
    assert (record["status"], record["metrics"], record["path"]) == ("complete", {"mpjpe_abs_mm": 2.5}, str(tmp_path))
