"""Configurations and properties of recordings: plain values by key; those of another kind are one sentence."""

import pytest
from hypothesis import given
from hypothesis import settings as trials
from hypothesis import strategies as st
from small_recordings import record

from workbench.cli import view
from workbench.cli.main import main
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.properties import check_settings, checked
from workbench.recording.read.reader import read
from workbench.recording.settings import NO_EFFECT, choices_of, leaves, numbers_and_texts
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
    monkeypatch.setattr(
        "workbench.recording.read.crash_probe.crashing_recordings", lambda *_: set()
    )  # which test_open_runs tests
    assert main(["report", str(beside.parent)]) == main(["view", str(beside.parent)]) == 0
    shown = capsys.readouterr()
    assert "hostile.rrd" in shown.out + shown.err
    assert main(["export", str(beside), "-o", str(beside.with_suffix(".csv"))]) == 2
    sentence = capsys.readouterr().err
    assert len(sentence) <= LONGEST + 1
    assert "Traceback" not in sentence


def test_a_refused_recording_hides_no_sound_one(beside):
    with RecordingFile(beside, run_id="hostile", config_yaml="seed: 3", provenance={"seed": 0}) as file:
        file.send_property("metrics", {"mpjpe_abs_mm": "many"})
    runs, (problem,) = open_sound_runs(beside.parent)
    assert ([run.path.name for run in runs], problem.path) == (["sound.rrd"], beside)


def test_a_sound_one_passes(tmp_path):
    run = read(record(tmp_path / "a.rrd", "a"))
    assert checked(run.path, dict(run.properties)) == run.properties
    check_settings(run.path, {"seed": 3, "prior": {"a": [1, 2.5, "b", None, True]}, "study": None})


SETTINGS = {
    "seed": 3, "n_threads": None,
    "prior": {"_target_": "workbench.priors.smooth.Smooth", "sigma": 1.0e-3, "held": True},
    "dataset": {"motion": "35_02", "view": [1, 2.5]}, "clips": {"validation": ["35_02"]}, "paths": {"data": "/my/own"},
}  # fmt: skip


def test_numbers_are_told_from_texts():
    numbers, texts = numbers_and_texts(SETTINGS, {"prior": "smooth"})
    assert numbers == {"seed": 3.0, "prior.sigma": 1.0e-3}
    assert texts == {"prior.held": "true", "dataset.motion": "35_02", "dataset.view": "[1, 2.5]", "prior": "smooth"}


def test_leaves_go_into_lists_where_that_is_asked_for():
    nested = {"a": {"b": [1, {"c": 2}]}, "d": {}, "e": []}
    assert dict(leaves(nested)) == {"a.b": [1, {"c": 2}], "e": []}
    assert dict(leaves(nested, lists=True)) == {"a.b[0]": 1, "a.b[1].c": 2, "d": {}, "e": []}


def test_what_has_no_effect_is_no_column():
    assert numbers_and_texts({key: {"n": 1, "word": "w"} for key in NO_EFFECT}, {"recorder": "rerun"}) == ({}, {})


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats() | st.text(max_size=5),
    lambda of: st.lists(of, max_size=3) | st.dictionaries(st.text(max_size=5), of, max_size=4),
)


@trials(max_examples=40)
@given(settings=st.dictionaries(st.text(max_size=5), VALUES), words=st.lists(st.text(max_size=8)) | st.text(max_size=8))
def test_whatever_a_configuration_holds_its_keys_are_numbers_or_texts(settings, words):
    numbers, texts = numbers_and_texts(settings, choices_of(words))
    assert all(type(value) is float for value in numbers.values())
    assert all(type(value) is str for value in texts.values())
    assert "" not in {*numbers, *texts}
