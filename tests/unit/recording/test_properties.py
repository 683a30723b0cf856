"""Configurations and properties of recordings are plain values by key; others are rejected with one message."""

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
"""tests/robustness has more of them."""


@pytest.fixture
def hostile(tmp_path):
    """Record a valid run and return the path for a hostile one in the same folder."""
    record(tmp_path / "valid.rrd", "valid")
    return tmp_path / "hostile.rrd"


def configured(path, text):
    with RecordingFile(path, run_id="hostile", config_yaml=text, provenance={"seed": 0, "experiment": "x"}):
        pass


@pytest.mark.parametrize("kind", CONFIGS)
@pytest.mark.usefixtures("trusted")
def test_every_command_rejects_a_hostile_configuration_with_one_message(hostile, kind, capsys, monkeypatch):
    configured(hostile, CONFIGS[kind])
    with pytest.raises(InputError, match=r"hostile\.rrd: "):
        _ = read(hostile).settings
    monkeypatch.setattr(view, "viewer", lambda: "true")
    assert main(["report", str(hostile.parent)]) == main(["view", str(hostile.parent)]) == 0
    output = capsys.readouterr()
    assert "hostile.rrd" in output.out + output.err
    assert main(["export", str(hostile), "-o", str(hostile.with_suffix(".csv"))]) == 2
    message = capsys.readouterr().err
    assert len(message) <= LONGEST + 1
    assert "Traceback" not in message


@pytest.mark.usefixtures("trusted")
def test_valid_recordings_are_read_next_to_a_rejected_one(hostile):
    with RecordingFile(hostile, run_id="hostile", config_yaml="seed: 3", provenance={"seed": 0}) as file:
        file.send_property("metrics", {"mpjpe_abs_mm": "many"})
    runs, (problem,) = open_sound_runs(hostile.parent)
    assert ([run.path.name for run in runs], problem.path) == (["valid.rrd"], hostile)


def test_properties_and_settings_of_a_valid_recording_pass(tmp_path):
    run = read(record(tmp_path / "a.rrd", "a"))
    assert checked(run.path, dict(run.properties)) == run.properties
    check_settings(run.path, {"seed": 3, "prior": {"a": [1, 2.5, "b", None, True]}, "study": None})


SETTINGS = {
    "seed": 3, "n_threads": None,
    "prior": {"_target_": "workbench.priors.smooth.Smooth", "sigma": 1.0e-3, "fixed": True},
    "dataset": {"motion": "35_02", "view": [1, 2.5]}, "clips": {"validation": ["35_02"]}, "paths": {"data": "/my/own"},
}  # fmt: skip


def test_settings_are_split_into_numbers_and_texts():
    numbers, texts = numbers_and_texts(SETTINGS, {"prior": "smooth"})
    assert numbers == {"seed": 3.0, "prior.sigma": 1.0e-3}
    assert texts == {"prior.fixed": "true", "dataset.motion": "35_02", "dataset.view": "[1, 2.5]", "prior": "smooth"}


def test_leaves_of_lists_are_optional():
    nested = {"a": {"b": [1, {"c": 2}]}, "d": {}, "e": []}
    assert dict(leaves(nested)) == {"a.b": [1, {"c": 2}], "e": []}
    assert dict(leaves(nested, lists=True)) == {"a.b[0]": 1, "a.b[1].c": 2, "d": {}, "e": []}


def test_settings_without_effect_are_omitted():
    assert numbers_and_texts({key: {"n": 1, "word": "w"} for key in NO_EFFECT}, {"recorder": "rerun"}) == ({}, {})


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats() | st.text(max_size=5),
    lambda values: st.lists(values, max_size=3) | st.dictionaries(st.text(max_size=5), values, max_size=4),
)


@trials(max_examples=40)
@given(settings=st.dictionaries(st.text(max_size=5), VALUES), words=st.lists(st.text(max_size=8)) | st.text(max_size=8))
def test_values_of_any_configuration_become_numbers_or_texts(settings, words):
    numbers, texts = numbers_and_texts(settings, choices_of(words))
    assert all(type(value) is float for value in numbers.values())
    assert all(type(value) is str for value in texts.values())
    assert "" not in {*numbers, *texts}
