"""A run that another command removes while it is taken over is none; what two sweeps take over, both have."""

import json
import os
import shutil

import pytest

from workbench.sweep.reuse import ASIDE, take_over


@pytest.fixture
def sweep(tmp_path):
    """A sweep's folder with a complete run that was set aside, and the folders of two jobs."""
    (aside := tmp_path / ASIDE / "same").mkdir(parents=True)
    (aside / "run.rrd").write_text("recorded")
    (aside / "summary.json").write_text(json.dumps({"status": "complete", "identity": "same"}))
    for name in ("0", "1"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.parametrize("links", [True, False])
def test_a_run_removed_meanwhile_is_not_taken_over(sweep, monkeypatch, links):
    def removed(*_):
        shutil.rmtree(sweep / ASIDE / "same")
        raise FileNotFoundError(2, "No such file or directory") if links else OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", removed)
    assert not take_over("same", sweep / "0", [sweep])
    assert os.listdir(sweep / "0") == []


def test_a_run_that_another_sweep_takes_over_too_is_taken_over(sweep, monkeypatch):
    whole = shutil.rmtree

    def other(folder, **options):
        monkeypatch.undo()
        whole(folder)
        shutil.rmtree(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", other)
    assert take_over("same", sweep / "0", [sweep])
    assert (sweep / "0" / "run.rrd").read_text() == "recorded"
    assert json.loads((sweep / "0" / "summary.json").read_text())["taken_from"] == str(sweep / ASIDE / "same")
    assert not take_over("same", sweep / "1", [sweep / "1"])
