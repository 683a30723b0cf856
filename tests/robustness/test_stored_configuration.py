"""The configuration and properties of an untrusted recording are plain data and name only components."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from damage import changes, damaged, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from valid_files import YAML

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.recording.read.chunks import Curve
from workbench.recording.read.properties import check_settings, checked
from workbench.recording.read.reader import Run
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.page import terminal
from workbench.utils.input_limits import DEEPEST, parse_yaml

PATH = Path("a.rrd")
BOMBS = {
    "references to references": "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join([f'*{chr(97 + k)}'] * 9)}]\n" for k in range(9)
    ),
    "lists in one another": "a: " + "[" * 100_000, "mappings in one another": "{a: " * 5000, "dashes": "- " * 50_000,
    "hexadecimal digits": "seed: 0x" + "f" * 6000, "sexagesimal digits": "seed: " + ":".join(["59"] * 300_000),
    "digits": "seed: " + "9" * 5000, "a Python object": "a: !!python/object/apply:os.system [id]",
    "a set": "a: !!set {x}", "a date": "a: 2026-01-01", "bytes": "a: !!binary aGk=", "a surrogate": 'a: "\\ud800"',
    "no mapping": "just words", "numbers as keys": "1: 2", "torn": "a: [", "long": "a: " + "x" * 2_000_000,
    "an empty number": "a: !!int ''", "no truth": "a: !!bool x", "no time": "a: !!timestamp x",
}  # fmt: skip


def run_with(text=YAML, **properties):
    """Return a run whose recording has the given configuration and properties."""
    plain = {"run": {"id": "b", "status": "complete"}, "config": {"TextDocument:text": text}, "provenance": {"seed": 3}}
    return Run(PATH, plain | properties, {"mpjpe_abs_mm": Curve(np.arange(3), np.ones((3, 1)))})


@given(changes)
@settings(max_examples=300)
@pytest.mark.slow
def test_random_damage_is_refused_or_read(chosen):
    text = damaged(YAML.encode(), chosen).decode("utf-8", "surrogateescape")
    if not refusal(lambda: run_with(text).settings):
        json.dumps(run_with(text).settings).encode()


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_bomb_is_refused(bomb):
    assert refusal(lambda: run_with(BOMBS[bomb]).settings).startswith("a.rrd: ")


def test_nesting_up_to_the_limit_is_read():
    assert parse_yaml(PATH, "[" * DEEPEST + "]" * DEEPEST)


plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary() | st.dates()
nested = st.recursive(plain, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3))


@given(st.dictionaries(st.sampled_from(["seed", "prior", "paths", "check", "note"]), nested, max_size=4))
@settings(max_examples=100)
@pytest.mark.slow
def test_settings_that_are_not_plain_data_are_refused(values):
    if not refusal(check_settings, PATH, values):
        json.dumps(values).encode()


def test_references_are_not_resolved(monkeypatch):
    monkeypatch.setenv("SECRET", "42")
    assert run_with("name: ${oc.env:SECRET}\n").settings == {"name": "${oc.env:SECRET}"}


@cache
def defaults():
    prepare_hydra()
    return current_defaults([])


FOREIGN = (
    {"_target_": "os.system", "command": "id"}, {"_target_": "builtins.eval"}, {"_target_": "subprocess.run"},
    {"_target_": "workbench.utils.input_limits.check_sizes"}, {"_target_": "workbench.motion.library.write_library"},
    {"_target_": ["os.system"]}, {"_target_": "workbench.priors"}, {"a": [{"_target_": "os.system"}]},
    {"_target_": "workbench.priors.smooth.Smooth", "_args_": ["/tmp/x"]}, {"_partial_": True}, {"a": "${oc.env:HOME}"},
    {"a": "${oc.create:{_target_:os.system}}"}, {"motions": "/etc/passwd.h5"}, {"motions": "../../motions.h5"},
    {"motions": "~/.ssh/motions.h5"}, {"motion": "rtsp://example.org/x.bvh"}, {"motion": "C:\\x.bvh"},
)  # fmt: skip


@pytest.mark.parametrize("foreign", FOREIGN, ids=str)
def test_only_components_are_accepted(foreign):
    message = refusal(runnable_config, run_with(yaml.safe_dump({"seed": 3, "prior": foreign})), [], defaults())
    assert message.startswith("a.rrd: prior.")


@given(st.text(min_size=1) | st.from_regex(r"(os|builtins|workbench|hydra|numpy)\.[a-z_.]{1,20}", fullmatch=True))
@settings(max_examples=50)
def test_no_other_name_is_a_component(word):
    text = json.dumps({"seed": 3, "prior": {"_target_": word}})
    assert refusal(runnable_config, run_with(text), [], defaults())


SOUND = {
    "run": {"id": "a", "status": "complete", "format": 2, "platform": "x"},
    "config": {"TextDocument:text": YAML},
    "provenance": {"experiment": "walk", "seed": 3, "choices": ["prior=a", "body=b"], "workbench": "0.1"},
    "body": {"joints": list(JOINT_NAMES), "pose": list(POSE_NAMES)},
    "shape": {name: list(v) if isinstance(v, tuple) else v for name, v in from_height(1.7).as_dict().items()},
    "metrics": {"mpjpe_abs_mm": 1.0, "n_frames": 3.0}, "cost": {"seconds": 1.0},
    "marginals": {"names": ["a"], "units": ["m"], "low": 0.0, "high": 1.0, "frames": [0.0, 1.0]},
}  # fmt: skip
VALUES = (
    "a", "", "complete", "nan", "\ud800", "x" * 1000, "<script>\x1b[31m", 0, -1, 2**40, 10**400, 3.5, float("nan"),
    float("inf"), 1e300, True, None, b"x", [], [1.0, 2.0], ["a", "b"], ["a", 1], [[1.0], [2.0]], [None], {"a": 1}, (1,),
)  # fmt: skip
places = [(name, key) for name, keys in SOUND.items() for key in keys]


@given(st.dictionaries(st.sampled_from(places), st.sampled_from(VALUES), min_size=1, max_size=3))
@settings(max_examples=200)
@pytest.mark.slow
def test_changed_properties_are_refused_or_reported_with_the_sound_run(values):
    properties = {name: dict(keys) for name, keys in SOUND.items()}
    for (name, key), value in values.items():
        properties[name][key] = value
    if refusal(checked, PATH, properties):
        return
    changed, sound = run_with(**checked(PATH, properties)), run_with(metrics={"mpjpe_abs_mm": 2.0})
    report = terminal(contents(group_runs([changed, sound])))
    assert "2" in report
    assert "\x1b" not in report
    report.encode()
