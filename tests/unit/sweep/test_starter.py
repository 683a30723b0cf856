"""Whether anybody still starts the jobs of a sweep."""

import json
import os
import platform

import pytest

from workbench.sweep.starter import FILE, begin, end, leave, state_of

PID_NEVER = 2**22 + 1  # above what Linux gives


def test_one_is_there_until_it_is_done(tmp_path):
    sweep = tmp_path / "new" / "sweep"
    assert state_of(sweep) is None
    begin(sweep, needed=True)
    assert state_of(sweep) == "there"
    end(sweep)
    assert state_of(sweep) == "done"
    begin(sweep, needed=True)
    assert state_of(sweep) == "there"


def test_jobs_that_are_left_to_themselves_have_no_starter(tmp_path):
    begin(tmp_path, needed=False)
    leave(tmp_path)
    end(tmp_path)
    assert state_of(tmp_path) is None


@pytest.mark.parametrize(
    ("host", "pid", "state"),
    [
        (platform.node(), PID_NEVER, "gone"),
        ("elsewhere", PID_NEVER, "there"),
        (platform.node(), "own", "there"),
        (platform.node(), None, "there"),
        (platform.node(), 10**30, None),
        (platform.node(), "x", None),
    ],
)
def test_one_that_was_killed_is_gone_as_far_as_this_machine_can_tell(tmp_path, host, pid, state):
    pid = os.getpid() if pid == "own" else pid  # whose name is another in every process that collects this test
    (tmp_path / FILE).write_text(json.dumps({"host": host, "pid": pid, "done": False}))
    assert state_of(tmp_path) == state


@pytest.mark.parametrize("text", ["", "[]", "3", "{", '{"done": 1}', "[" * 10**5])
def test_what_nobody_wrote_says_nothing(tmp_path, text):
    (tmp_path / FILE).write_text(text)
    assert state_of(tmp_path) is None


def test_a_folder_that_cannot_be_written_is_no_reason_to_stop(tmp_path):
    (tmp_path / "file").write_text("")
    begin(tmp_path / "file" / "sweep", needed=True)
    end(tmp_path / "file" / "sweep")
    leave(tmp_path / "file" / "sweep")
    assert state_of(tmp_path / "file" / "sweep") is None
