"""What a run comes to, and its folder: locked, complete whenever it is asked to end, and never overwritten."""

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
    """The summary of a run whose frames have these errors, of the n-th of which n particles count."""
    summary = Summary("experiment", 0, Path("run.rrd"))
    for n, values in enumerate(errors, start=1):
        summary.add(step_of(np.tile(standing(), (n, 1)), Truth()), values)
    return summary


def test_the_first_frame_which_is_given_is_left_out_of_the_means():
    metrics = summary_of({"mpjpe_abs_mm": 1000.0}, {"mpjpe_abs_mm": 30.0}, {"mpjpe_abs_mm": 50.0}).metrics
    assert metrics["mpjpe_abs_mm"] == pytest.approx(40.0)
    assert metrics["ess_mean"] == pytest.approx(2.5)
    assert metrics["n_frames"] == 3.0


def test_flexion_is_told_by_its_root_mean_square():
    metrics = summary_of(
        {}, *({"knee_flexion_rmse_deg": error, "mpjae_local_deg": error} for error in (3.0, 5.0))
    ).metrics
    assert metrics["knee_flexion_rmse_deg"] == pytest.approx(np.sqrt(17.0))
    assert metrics["mpjae_local_deg"] == pytest.approx(4.0)


def test_a_mean_is_over_the_frames_that_have_the_error():
    assert summary_of({}, {"mpjpe_px": 4.0}, {}, {"mpjpe_px": 8.0}).metrics["mpjpe_px"] == pytest.approx(6.0)


def test_how_a_run_ended_is_written_on_a_full_disk(tmp_path, monkeypatch):
    summary, path = summary_of({"mpjpe_px": 1.0}), tmp_path / "summary.json"
    summary.write(path)
    summary.run_metrics = {f"marker_offset_{k}_mm": 1.0 for k in range(200)}  # of which nothing was known when it began

    def refuse(*paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", refuse)
    summary.status, summary.error, summary.provenance = "failed", "OSError: no room", {"difference": "+" * 40_000}
    summary.write(path)
    found = json.loads(path.read_text())
    assert (found["status"], found["error"], found["seed"]) == ("failed", "OSError: no room", summary.seed)
    assert found["metrics"]["n_frames"] == 1.0
    assert "provenance" not in found


def test_a_folder_is_made_and_locked_for_one_run(tmp_path):
    folder = tmp_path / "new" / "run"
    with run_folder(folder):
        assert is_locked(folder)
        with pytest.raises(InputError, match="uses this folder"), run_folder(folder):
            pass
    assert not is_locked(folder)


def test_a_complete_run_is_set_aside_and_reported(tmp_path, caplog):
    for k in (1, 2):
        (tmp_path / "run.rrd").write_text(f"run {k}")
        (tmp_path / "summary.json").write_text(f"summary {k}")
        with caplog.at_level(logging.WARNING):
            set_aside(tmp_path)
        assert not (tmp_path / "run.rrd").exists()
        assert not (tmp_path / "summary.json").exists()
        aside = tmp_path / EARLIER / str(k)
        assert caplog.messages[-1] == f"{tmp_path}: the complete run in it was moved to {aside}"
        assert [(aside / name).read_text() for name in ("run.rrd", "summary.json")] == [f"run {k}", f"summary {k}"]


def test_what_a_killed_run_left_is_not_set_aside(tmp_path, caplog):
    (tmp_path / "run.rrd.part").write_text("a part")
    set_aside(tmp_path)
    assert not caplog.messages
    assert not (tmp_path / EARLIER).exists()


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="the folder cannot be created: "), run_folder(place):
            pass


STEPS = [module.__file__ for module in (files, run_module, summary_module, signals)]


def publish(folder, number=None, at=None):
    """Publish an empty run and ask the process to end at a line of it, of a loop the first time; how many there are."""
    run, reached = Summary("walk", 0, folder / "run.rrd"), set()

    def step(frame, event, _):
        if frame.f_code.co_filename not in STEPS or frame.f_code.co_name in ("metrics", "cost", "handle"):
            return None
        before = len(reached)
        reached.add((frame, frame.f_lineno))
        if event == "line" and len(reached) > before and len(reached) == at:
            sys.settrace(None)
            signal.raise_signal(number)
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
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_recording_and_summary_agree_at_whatever_step_a_signal_arrives(number, tmp_path):
    said = set()
    for at in range(1, publish(tmp_path / "whole") + 1):
        folder = tmp_path / str(at)
        publish(folder, number, at)
        told = json.loads((folder / "summary.json").read_text())["status"]
        published = (folder / "run.rrd").is_file()
        recorded = read(folder / ("run.rrd" if published else "run.rrd.part")).status
        assert (told, recorded) in (
            [("complete", "complete")] if published else [("interrupted", "interrupted"), ("interrupted", "running")]
        ), at
        said.add(told)
    assert said == {"complete", "interrupted"}


def test_a_run_that_was_killed_once_it_was_published_is_complete(tmp_path):
    with ending(Summary("walk", 0, tmp_path / "run.rrd")):
        kept = (tmp_path / "summary.json").read_bytes()
        with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}) as file:
            file.send_numbers("metrics", {"mpjpe_abs_mm": 2.5})
    (tmp_path / "summary.json").write_bytes(kept)  # "running", of a process that is gone
    record = read_run(tmp_path)
    assert (record["status"], record["metrics"], record["path"]) == ("complete", {"mpjpe_abs_mm": 2.5}, str(tmp_path))
