"""Recordings of another kind than ours are one sentence for every command, and hide no sound one beside them."""

import pytest
from small_recordings import record

from workbench.cli import view
from workbench.cli.main import main
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.properties import check_settings, checked
from workbench.recording.read.reader import read
from workbench.recording.write.file import RecordingFile
from workbench.utils.errors import LONGEST, InputError

CONFIGS = {"text": "seed: 3\ndataset: x", "surrogate": 'seed: 3\na: "\\ud800"', "flow": "seed: " + "[" * 3000}
"""Others: see tests/robustness."""


@pytest.fixture
def beside(tmp_path):
    """A sound recording, and where a hostile one is to be."""
    record(tmp_path / "sound.rrd", "sound")
    return tmp_path / "hostile.rrd"


def configured(path, text):
    with RecordingFile(path, run_id="hostile", config_yaml=text, provenance={"seed": 0, "experiment": "x"}):
        pass


@pytest.mark.parametrize("kind", CONFIGS)
def test_a_hostile_configuration_is_one_sentence_of_every_command(beside, kind, capsys, monkeypatch):
    configured(beside, CONFIGS[kind])
    with pytest.raises(InputError, match=r"hostile\.rrd: "):
        _ = read(beside).settings
    monkeypatch.setattr(view, "viewer", lambda: "true")
    monkeypatch.setattr("workbench.recording.read.crash_probe.fatal", lambda *_: set())  # which test_open_runs tests
    assert main(["report", str(beside.parent)]) == main(["view", str(beside.parent)]) == 0
    shown = capsys.readouterr()
    assert "hostile.rrd" in shown.out + shown.err
    assert main(["export", str(beside), "-o", str(beside.with_suffix(".csv"))]) == 2
    sentence = capsys.readouterr().err
    assert len(sentence) <= LONGEST + 1
    assert "Traceback" not in sentence


def test_a_refused_recording_hides_no_sound_one(beside):
    with RecordingFile(beside, run_id="hostile", config_yaml="seed: 3", provenance={"seed": 0}) as file:
        file.send_property("metrics", {"error_abs_mm": "many"})
    runs, (problem,) = open_sound_runs(beside.parent)
    assert ([run.path.name for run in runs], problem.path) == (["sound.rrd"], beside)


def test_a_sound_one_passes(tmp_path):
    run = read(record(tmp_path / "a.rrd", "a"))
    assert checked(run.path, dict(run.properties)) == run.properties
    check_settings(run.path, {"seed": 3, "prior": {"a": [1, 2.5, "b", None, True]}, "study": None})
