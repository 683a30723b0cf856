"""What a job's folder says of it."""

import json
import os
import platform
import subprocess
import sys

import pytest

from workbench.sweep.job import BEFORE, CUT_OFF, STOP_WHEN, alone, at_work, put_back, read_summary, say_if_gone


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({}, "failed"),
        ({"pid": os.getpid()}, "running"),
        ({"host": "another"}, "running"),
        ({"status": "complete"}, "complete"),
    ],
)
def test_a_job_whose_process_is_gone_was_cut_off(tmp_path, changes, status):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    said = {"status": "running", "host": platform.node(), "pid": gone.pid, "error": None, "metrics": {}}
    (tmp_path / "summary.json").write_text(json.dumps({**said, **changes}))
    say_if_gone(tmp_path)
    summary = read_summary(tmp_path)
    assert summary["status"] == status
    assert (summary["error"] == CUT_OFF) == (status == "failed")


@pytest.mark.parametrize(
    ("written", "stop", "waits"), [("", None, True), ("a>0", "a>0", True), ("a>0", None, True), ("", "a>0", False)]
)
def test_what_an_attempt_recorded_waits_for_the_next_that_ends_no_earlier(tmp_path, written, stop, waits):
    (tmp_path / STOP_WHEN).parent.mkdir()
    (tmp_path / STOP_WHEN).write_text(written)
    (tmp_path / "run.rrd.part").write_text("frames")
    put_back(tmp_path, stop)
    assert [each.read_text() for each in (tmp_path / BEFORE).glob("*.rrd.part")] == ["frames"] * waits
    assert (tmp_path / "run.rrd.part").is_file() != waits


def test_a_folder_is_worked_in_as_long_as_its_lock_is_held(tmp_path):
    assert not at_work(tmp_path)
    with alone(tmp_path):
        assert at_work(tmp_path)
    assert not at_work(tmp_path)
