"""At whatever step of publishing a run is asked to end, its recording and its summary say the same."""

import json
import signal
import sys

import pytest

from workbench.experiment import execute, summary
from workbench.experiment.execute import ending
from workbench.experiment.summary import Summary
from workbench.recording.read.reader import read
from workbench.recording.write import file as files
from workbench.recording.write.file import RecordingFile
from workbench.results.table import read_run
from workbench.utils import signals
from workbench.utils.signals import Interrupted, interruptible

STEPS = [module.__file__ for module in (files, execute, summary, signals)]


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
            file.send_numbers("metrics", {"error_abs_mm": 2.5})
    (tmp_path / "summary.json").write_bytes(kept)  # "running", of a process that is gone
    record = read_run(tmp_path)
    assert (record["status"], record["metrics"], record["path"]) == ("complete", {"error_abs_mm": 2.5}, str(tmp_path))
