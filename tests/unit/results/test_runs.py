"""Recorded runs in Python: a sequence that is a table."""

import pytest
from run_folders import leave, leave_sweep

import workbench as wb
from workbench.utils.errors import InputError


def test_runs_are_newest_first_and_a_table(tmp_path):
    leave_sweep(tmp_path / "sweep")
    leave(tmp_path / "lost", prior="implicit", status="failed", error=400.0, day=28, experiment="other")
    found = wb.runs(tmp_path)
    assert len(found) == 13
    assert (found[0].status, found[0].experiment) == ("failed", "other")
    table = found.table()
    assert table["path"] == [entry.path for entry in found]
    assert table["prior"][:2] == ["implicit", "walking"]
    assert table["error_abs_mm"][0] == 400.0
    assert {len(column) for column in table.values()} == {13}
    frame = found.pandas() if pytest.importorskip("pandas") else None
    assert frame.groupby("prior")["error_abs_mm"].mean()["smooth"] == 12.5


def test_without_a_folder_they_are_those_below_recordings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="recordings: expected a folder of runs"):
        wb.runs()
    leave(tmp_path / "recordings" / "runs" / "a")
    assert [entry.path for entry in wb.runs()] == ["recordings/runs/a"]
