"""Suggestions for mistyped options and keys, arguments quoted for Hydra, and the lines printed after a run."""

import sys
import tomllib
from dataclasses import make_dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra import compose, initialize_config_module
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.cli import run_output
from workbench.cli.error_messages import message_of, report_error
from workbench.cli.hydra_quoting import quoted
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.experiment.config.schema import prepare_hydra
from workbench.utils.finding import Finding


class _UnknownKeyError(Exception):
    object_type = make_dataclass("Filter_keys", [("_target_", str), ("n_particles", int), ("algorithm", str)])


def test_an_unknown_option_or_key_is_answered_by_the_closest_and_all_existing_ones():
    *options, suggestion = message_of(ValueError("In 'config': Could not find 'dataset/syntetic'\nAvailable options"))
    assert "syntetic" in suggestion
    assert "dataset=synthetic" in suggestion
    assert "  dataset=video" in options
    error = ValueError("Could not override 'inference.n_particle'.")
    error.__cause__ = _UnknownKeyError("Key 'n_particle' not in 'Filter_keys'\nfull_key: inference.n_particle")
    *keys, suggestion = message_of(error)
    assert {"  inference.algorithm", "  inference.n_particles"} <= set(keys)
    assert "inference.n_particles" in suggestion


@pytest.mark.parametrize(
    ("plugin", "extra"),
    [("launcher/joblib", "sweep"), ("launcher/submitit_slurm", "cluster"), ("sweeper/optuna", "tune")],
)
def test_a_missing_plugin_is_named_with_its_extra(plugin, extra):
    (message,) = message_of(ValueError(f"In 'hydra/config': Could not find 'hydra/{plugin}'\nAvailable options in"))
    assert message == f"hydra/{plugin.replace('/', '=')} requires a plug-in of Hydra: pip install -e '.[{extra}]'"
    pyproject = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    packages = pyproject["project"]["optional-dependencies"][extra]
    assert any(plugin.split("/")[1].partition("_")[0] in name for name in packages)


@pytest.mark.parametrize(
    ("override", "unknown", "suggestion"),
    [("sed=3", "sed", "seed"), ("prior=walkin", "walkin", "prior=walking"), ("paper=theirs", "theirs", "")],
)
def test_an_override_that_hydra_rejects_gets_a_suggestion(override, unknown, suggestion):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"), pytest.raises(HydraException) as raised:
        compose("config", overrides=[override])
    message = message_of(raised.value)[-1]
    assert unknown in message
    assert suggestion in message


@pytest.fixture
def summary(tmp_path):
    metrics = {"mpjpe_abs_mm": 31.0, "pa_mpjpe_mm": 25.0, "ess_mean": 500.0, "marker_offset_neck_mm": 3.0}
    return SimpleNamespace(
        verdict=Verdict((), Finding("tracked", "in all 9 frames"), ()), metrics=metrics,
        uninformative_metrics=frozenset({"ess_mean"}),
        study=None, cost={"seconds": 2.0, "ms_per_frame": 200.0, "compile_s": 7.0}, timing={},
        recording=tmp_path / "a folder" / "run.rrd",
    )  # fmt: skip


def test_the_last_line_is_a_command_that_opens_the_recording(summary, tmp_path, monkeypatch):
    """The command also works outside the virtual environment and for a folder with a blank in its name."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "workbench").touch(mode=0o755)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setattr(sys, "executable", str(tmp_path / "bin" / "python"))
    for path, working_folder, command in (
        ("/nowhere", ".", "bin/workbench view 'a folder/run.rrd'"),
        (tmp_path / "bin", ".", "workbench view 'a folder/run.rrd'"),
        (tmp_path / "bin", "elsewhere", f"workbench view '{tmp_path / 'a folder' / 'run.rrd'}'"),
    ):
        monkeypatch.setenv("PATH", str(path))
        monkeypatch.chdir(tmp_path / working_folder)
        assert [*run_output.summary_lines(summary)][-1].endswith(f" {command}")


def value_of(argument):
    return OverridesParser.create().parse_override(argument).value()


CHARACTERS = st.characters(codec="utf-8", exclude_categories=("Cc", "Zl", "Zp"), exclude_characters="\\")


@settings(max_examples=25)
@given(st.text(CHARACTERS, min_size=1))
def test_folder_names_reach_hydra_unchanged(name):
    if "${" not in name:
        assert value_of(quoted(f"hydra.run.dir=runs/{name}/x")) == f"runs/{name}/x"


@pytest.mark.parametrize("value", ["n_track_losses>0", "Läufe/日本.bvh", "a#b", "<3"])
def test_unambiguous_texts_are_quoted(value):
    assert quoted(f"any.key={value}") == f"any.key='{value}'"


@pytest.mark.parametrize("name", ["1e3", "12.50", "null", "true", "0123", "7", " a.mp4", "a (1).mp4", "a.mp4"])
def test_existing_files_reach_hydra_by_their_names(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("")
    assert str(value_of(quoted(f"dataset.source={name}"))) == name


def test_a_value_that_hydra_does_not_parse_is_explained():
    with pytest.raises(HydraException) as error:
        OverridesParser.create().parse_overrides([quoted("dataset.sources={left: walk (1).mp4}")])
    assert "'walk (1).mp4'" in message_of(error.value)[-1]


@pytest.mark.parametrize(
    "argument",
    ["sweep.stop_if='n_track_losses>0'", "seed=1,2", "seed=range(5)", "seed=[1", "x={a: ü}", "prior=a,ü", "x=a b",
     "x=", "hydra.run.dir='Läufe'", "hydra.run.dir=${now:%Y}", "-m", "--cfg=job", "from"],
)  # fmt: skip
def test_hydra_syntax_is_not_quoted(argument):
    assert quoted(argument) == argument


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (MemoryError(), 1), (MemoryError("Unable to allocate 16.0 GiB for an array"), 1),
        (ImportError("libx.so: failed to map segment from shared object"), 1),
        (OSError(12, "Cannot allocate memory"), 1), (RuntimeError("std::bad_alloc"), 1),
        (ImportError("No module named x"), None), (RuntimeError("other"), None),
        (ValueError("Expected header format: KEY VALUE, got '@package'"), 2), (ValueError("other"), None),
        (ValueError("Config group override must be a string or a list. Got float"), 2),
        (OSError(36, "File name too long", "x" * 5000), 2), (PermissionError(13, "Permission denied", "a.rrd"), 2),
        (OSError(5, "Input/output error"), None),
    ],
)  # fmt: skip
def test_a_lack_of_memory_is_one_sentence(capsys, error, code):
    assert report_error(error) == code
    out = capsys.readouterr().err
    assert ("not enough memory" in out) == (code == 1)
    assert out.count("\n") == (code is not None)
