"""The folder of a run: taken by one, told who by, and what it held is kept."""

import logging
import os

import pytest

from workbench.errors import InputError
from workbench.experiment.folder import refuse_if_taken, taken


def test_a_folder_is_taken_by_one_run_and_free_afterwards(tmp_path):
    folder = tmp_path / "new" / "run"
    refuse_if_taken(folder)
    with taken(folder):
        for take in (lambda: taken(folder).__enter__(), lambda: refuse_if_taken(folder)):
            with pytest.raises(InputError, match=rf"run: a run is at work there, process {os.getpid()} on "):
                take()
    refuse_if_taken(folder)
    with taken(folder):
        pass


def test_a_lock_of_a_process_that_is_gone_does_not_count(tmp_path):
    (tmp_path / ".taken").write_text("process 4194304 on nowhere")
    with taken(tmp_path):
        assert str(os.getpid()) in (tmp_path / ".taken").read_text()


def test_a_complete_run_is_kept_and_told(tmp_path, caplog):
    for k in (1, 2):
        (tmp_path / "run.rrd").write_text(f"run {k}")
        (tmp_path / "summary.json").write_text(f"summary {k}")
        with caplog.at_level(logging.WARNING), taken(tmp_path):
            assert not (tmp_path / "run.rrd").exists()
            assert not (tmp_path / "summary.json").exists()
        kept = tmp_path / ".before" / str(k)
        assert caplog.messages[-1] == f"{tmp_path}: held a complete run, which is now in {kept}"
        assert [(kept / name).read_text() for name in ("run.rrd", "summary.json")] == [f"run {k}", f"summary {k}"]


def test_what_a_killed_run_left_is_not_kept(tmp_path, caplog):
    (tmp_path / "run.rrd.part").write_text("a part")
    with taken(tmp_path):
        pass
    assert not caplog.messages
    assert not (tmp_path / ".before").exists()


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="cannot be the folder of a run: "), taken(place):
            pass
