"""A recording in a notebook: by rerun-notebook, which is optional, and without the network."""

import os
import sys
from types import ModuleType

import pytest

from workbench.recording.read.notebook import notebook_viewer
from workbench.utils.errors import InputError

ASSET = "RERUN_NOTEBOOK_ASSET"


class Viewer:
    """A widget as rerun-notebook's, which keeps what it is sent and the setting at its making."""

    def __init__(self, **options):
        self.options, self.sent, self.asset = options, b"", os.environ.get(ASSET)

    def send_rrd(self, data):
        self.sent += data


@pytest.fixture
def installed(monkeypatch):
    module = ModuleType("rerun_notebook")
    module.Viewer = Viewer
    monkeypatch.setitem(sys.modules, "rerun_notebook", module)
    monkeypatch.delenv(ASSET, raising=False)


def test_the_widget_has_the_whole_recording_and_the_environment_is_unchanged(installed, tmp_path):
    path = tmp_path / "run.rrd"
    path.write_bytes(b"RRF2 and more")
    assert notebook_viewer(path).sent == b"RRF2 and more"
    assert ASSET not in os.environ


def test_a_users_choice_of_the_viewers_files_is_respected(installed, tmp_path, monkeypatch):
    (tmp_path / "run.rrd").write_bytes(b"RRF2")
    monkeypatch.setenv(ASSET, "inline")
    assert notebook_viewer(tmp_path / "run.rrd").asset == os.environ[ASSET] == "inline"


def test_a_missing_recording_is_named(installed, tmp_path):
    with pytest.raises(InputError, match=r"gone\.rrd: cannot be read: No such file"):
        notebook_viewer(tmp_path / "gone.rrd")


def test_without_the_package_the_remedy_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    monkeypatch.delenv(ASSET, raising=False)
    with pytest.raises(InputError, match=r"requires rerun-notebook .+ pip install -e '\.\[notebook\]'"):
        notebook_viewer(tmp_path / "run.rrd")
    assert ASSET not in os.environ
