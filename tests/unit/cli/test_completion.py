"""Shell completion of groups, options and keys."""

import os
import subprocess
import sys

import pytest

from workbench.cli.completion import completions
from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import composed
from workbench.experiment.config.static_keys import chosen_options, component_keys

COMPONENTS = [(group, name) for group in GROUPS for name, option in options(group).items() if option.target]


@pytest.mark.parametrize("group", ["experiment", "paper", *GROUPS])
def test_options_follow_the_equals_sign(group):
    assert completions(f"{group}=", []) == [f"{group}={name}" for name in options(group)]


@pytest.mark.parametrize(
    ("word", "words", "expected"),
    [
        ("prior=wal", [], ["prior=walking"]),
        ("+prior=wal", [], ["+prior=walking"]),
        ("prior=walking,smo", [], ["prior=walking,smooth"]),
        ("inference@inference.filter=gauss", [], ["inference@inference.filter=gauss_newton"]),
        ("pri", [], ["prior=", "prior."]),
        ("see", [], ["seed="]),
        ("pap", [], ["paper=literal", "paper=ours"]),
        ("sweep.re", [], ["sweep.resume=", "sweep.reuse="]),
        ("check.mpjpe_px.", [], ["check.mpjpe_px.absolute=", "check.mpjpe_px.relative="]),
        ("dataset.calib", ["dataset=multi_view"], ["dataset.calibration_file="]),
        ("dataset.calib", ["experiment=video"], ["dataset.calibration_file="]),
        ("dataset.sou", ["experiment=video", "dataset=multi_view"], ["dataset.sources="]),
        ("inference.alg", [], ["inference.algorithm.resampling=", "inference.algorithm.ess_threshold="]),
        ("inference.algorithm.ess", ["inference=particle_filter"], ["inference.algorithm.ess_threshold="]),
        ("nothing=", [], []),
        ("seed=", [], []),
        ("nothing.", [], []),
        ("dataset.", ["dataset=nothing"], []),
        ("prior=", ["component_packages=[no_such_package]"], []),
        ("prior=", ["component_packages=3"], []),
    ],
)
def test_words_are_completed(word, words, expected):
    assert completions(word, words) == expected


@pytest.mark.parametrize(("group", "name"), COMPONENTS)
def test_the_keys_read_from_the_sources_are_those_of_the_class(group, name):
    option = options(group)[name]
    assert sorted(component_keys(option)) == sorted(config_keys(import_target(option.target)))


@pytest.mark.parametrize("experiment", ["walk_multi_cue", "video", "balance_4cam", "points_hybrid"])
def test_the_options_of_an_experiment_are_those_that_hydra_composes(experiment):
    words = [f"experiment={experiment}"]
    choices = composed(words, with_hydra=True).hydra.runtime.choices
    chosen = chosen_options({"experiment": experiment})
    assert {group: chosen[group] for group in GROUPS if group != "study"} == {
        group: choices[group] for group in GROUPS if group != "study"
    }


def test_a_package_of_ones_own_is_completed(tmp_path, monkeypatch):
    (tmp_path / "my_parts" / "conf" / "prior").mkdir(parents=True)
    (tmp_path / "my_parts" / "__init__.py").touch()
    (tmp_path / "my_parts" / "fast.py").write_text(
        "from dataclasses import dataclass\n@dataclass\nclass Base:\n    rate: float = 1.0\n"
        "@dataclass\nclass Fast(Base):\n    sigma: float = 1.0\n"
    )
    text = "_target_: my_parts.fast.Fast\n# A prior.\n#   sigma: width\n#   rate: per second\n"
    (tmp_path / "my_parts" / "conf" / "prior" / "fast.yaml").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("workbench.experiment.config.options._allowed", [])
    words = ["component_packages=[my_parts]", "prior=fast"]
    assert completions("prior=fa", words) == ["prior=fast"]
    assert completions("prior.", words) == ["prior.rate=", "prior.sigma="]


def shell(**variables):
    """Return what the command prints to a shell that completes a line, and whether Hydra and NumPy were imported."""
    code = (
        "import sys, atexit; from workbench.cli.main import main\n"
        "atexit.register(lambda: print({'hydra', 'numpy'} & set(sys.modules)))\nmain([])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | variables, capture_output=True, text=True, check=False
    )
    *words, imported = done.stdout.splitlines()
    assert imported == "set()", done.stderr
    return words


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "prior", "=", "wal"], ["walking"]),
        (["run", "seed=3", "prior=wal"], ["prior=walking"]),
        (["run", "paper", "="], ["literal", "ours"]),
        (["run", "dataset", "=", "video", "dataset.calib"], ["dataset.calibration_file="]),
    ],
)
def test_bash_replaces_what_follows_the_equals_sign(words, expected):
    line = "\n".join(["workbench", *words])
    variables = {"_WORKBENCH_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    assert shell(**variables) == expected


def test_zsh_replaces_the_word_and_nothing_slow_is_imported():
    (line,) = shell(_WORKBENCH_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="workbench run seed=3 prior=wal")
    assert '"prior=walking"' in line
