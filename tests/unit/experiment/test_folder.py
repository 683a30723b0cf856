"""The folder of a run: made, locked, and a complete run in it is not lost."""

import logging

import pytest

from workbench.experiment.summary import set_aside
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import is_locked, run_folder


def test_a_folder_is_made_and_locked_for_one_run(tmp_path):
    folder = tmp_path / "new" / "run"
    with run_folder(folder):
        assert is_locked(folder)
        with pytest.raises(InputError, match="is at work in this folder"), run_folder(folder):
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
        assert caplog.messages[-1] == f"{tmp_path}: held a complete run, which is now in {aside}"
        assert [(aside / name).read_text() for name in ("run.rrd", "summary.json")] == [f"run {k}", f"summary {k}"]


def test_what_a_killed_run_left_is_not_set_aside(tmp_path, caplog):
    (tmp_path / "run.rrd.part").write_text("a part")
    set_aside(tmp_path)
    assert not caplog.messages
    assert not (tmp_path / EARLIER).exists()


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="cannot be the folder of a run: "), run_folder(place):
            pass
