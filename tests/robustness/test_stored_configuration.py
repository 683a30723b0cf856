"""The configuration and properties of an untrusted recording are plain data and name only components."""

import inspect
import json
from copy import deepcopy
from functools import cache
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
import yaml
from damage import changes, damaged, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import MISSING, OmegaConf
from valid_files import YAML

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.experiment.config.instantiate import build, import_target
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import RunSchema, composed, prepare_hydra
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


SMOOTH, GAIT = "workbench.priors.smooth.Smooth", "workbench.priors.from_motions.gait"
FOREIGN = (
    {"_target_": "os.system", "command": "id"}, {"_target_": "builtins.eval"}, {"_target_": "subprocess.run"},
    {"_target_": "workbench.utils.input_limits.check_sizes"}, {"_target_": "workbench.motion.library.write_library"},
    {"_target_": ["os.system"]}, {"_target_": "workbench.priors"}, {"a": [{"_target_": "os.system"}]},
    {"_target_": "workbench.priors.smooth.Smooth", "_args_": ["/tmp/x"]}, {"_partial_": True}, {"a": "${oc.env:HOME}"},
    {"a": "${oc.create:{_target_:os.system}}"}, {"_target_": GAIT, "motions": "/etc/passwd.h5"},
    {"_target_": GAIT, "motions": "../../motions.h5"}, {"_target_": GAIT, "motions": "~/.ssh/motions.h5"},
    {"_target_": GAIT, "motions": "rtsp://example.org/x.h5"}, {"_target_": GAIT, "motions": "C:\\x.h5"},
    {"_target_": GAIT, "motions": "C:/x.h5"}, {"_target_": GAIT, "motions": "file:/etc/passwd"},
    {"_target_": GAIT, "exclude": ["02", "\\\\server\\x"]}, {"_target_": GAIT, "penalty": {"../x": 1.0}},
    {"_target_": GAIT, "subjects": ["/etc/passwd:x"]}, {"_target_": GAIT, "data": ""}, {"_target_": GAIT, "data": "."},
    {"_target_": SMOOTH, "sigmas": 1}, {"_target_": SMOOTH, "damping": "much"}, {"_target_": SMOOTH, "sigma": 3},
    {"_target_": SMOOTH, "sigma": {"angle": [1]}}, {"_target_": SMOOTH, "parameters": "left_knee"},
    {"_target_": SMOOTH, "parameters": [1]}, {"_target_": GAIT, "sigma_rotation": [0.1]},
    {"_target_": GAIT, "n_components": True}, {"_target_": "workbench.priors.ar_offsets.AROffsets", "base": 3},
    {"_target_": "workbench.priors.ar_offsets.AROffsets", "base": {"_target_": SMOOTH, "sigmas": 1}},
)  # fmt: skip


@pytest.mark.parametrize("foreign", FOREIGN, ids=str)
def test_only_components_are_accepted(foreign):
    message = refusal(runnable_config, run_with(yaml.safe_dump({"seed": 3, "prior": foreign})), [], defaults())
    assert message.startswith("a.rrd: prior.")


RECORDER = "workbench.recording.write.recorder.Recorder"
UNLISTED = {
    "recorder.path": {"recorder": {"_target_": RECORDER, "path": "notes.txt"}},
    "recorder.run_id": {"recorder": {"_target_": RECORDER, "run_id": "x"}},
    "recorder.provenance": {"recorder": {"_target_": RECORDER, "provenance": {}}},
    "recorder.body": {"recorder": {"_target_": RECORDER, "body": 3}},
    "recorder.source_video": {"recorder": {"_target_": RECORDER, "source_video": "x.mp4"}},
    "recorder.jpeg_quality": {"recorder": {"_target_": RECORDER, "jpeg_quality": "high"}},
    "recorder": {"recorder": {"path": "notes.txt"}}, "hydra": {"hydra": {"run": {"dir": "out"}}},
    "sweep": {"sweep": {"resume": "out"}}, "output": {"output": "notes.txt"}, "paths.runs": {"paths": {"runs": "out"}},
    "check.ess.path": {"check": {"ess": {"path": "x"}}}, "n_threads": {"n_threads": "all"},
    "training.cache": {"training": {"cache": "x"}}, "assumptions": {"assumptions": {"a": 1}},
}  # fmt: skip


@pytest.mark.parametrize("key", UNLISTED)
def test_only_the_keys_of_the_schema_are_accepted(key):
    message = refusal(runnable_config, run_with(yaml.safe_dump({"seed": 3, **UNLISTED[key]})), [], defaults())
    assert message.startswith(f"a.rrd: {key}: ")


@given(st.text(min_size=1) | st.from_regex(r"(os|builtins|workbench|hydra|numpy)\.[a-z_.]{1,20}", fullmatch=True))
@settings(max_examples=25)
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


@pytest.mark.parametrize("key", ["path", "run_id", "body", "provenance"])
def test_a_configuration_cannot_replace_the_objects_of_the_run(tmp_path, key):
    node = OmegaConf.create({"_target_": RECORDER, key: str(tmp_path / "x.rrd")})
    assert refusal(lambda: build(node, path=tmp_path / "run.rrd")) == f"config: {RECORDER} has no key {key!r}"


@cache
def components():
    """Return the components of all options and studies by group and class, as plain values, without paths.data."""
    chosen = [[f"{group}={name}" for name in options(group)] for group in GROUPS if group != "study"]
    compositions = [["experiment=custom", *filter(None, row)] for row in zip_longest(*chosen)]
    studies = [name for name, option in options("experiment").items() if "_study" in option.text]
    found = {}
    for overrides in (*compositions, *([f"experiment={name}"] for name in studies)):
        config = OmegaConf.to_container(composed([*overrides, "paths.data=null"]), resolve=True)
        for group in GROUPS:
            if (node := config[group]) is not None:
                filled = {"height_m": 1.7} | {key: "no/such" for key in node if key != "height_m"}
                found[group, node["_target_"]] = {k: filled[k] if v == MISSING else v for k, v in node.items()}
    return found


def test_the_configuration_of_every_component_is_accepted():
    """Those of experiments are those of the baselines, which `workbench check` repeats."""
    for (group, _), node in components().items():
        config = runnable_config(run_with(yaml.safe_dump({"seed": 3, group: node})), [], defaults())
        assert set(config[group]) >= set(node)


@cache
def recorded_keys():
    """Return (places of keys, component): those of every component, also nested and of its class, and of the top level.

    A place is the tuple of keys that lead to it.
    """
    return [
        *((place, node) for (group, _), node in components().items() for place in _places(node, (group,))),
        *(((name,), None) for name in (*RunSchema.__dataclass_fields__, "hydra", "experiment", "output")),
        *(((name, key), None) for name in ("paths", "check", "training", "clips", "sweep") for key in ("data", "x")),
    ]


def _places(node, place):
    if "_target_" in node:
        yield from ((*place, name) for name in inspect.signature(import_target(node["_target_"])).parameters)
    for key, value in node.items():
        yield (*place, key)
        if isinstance(value, dict):
            yield from _places(value, (*place, key))


def _texts(value):
    if isinstance(value, dict):
        yield from (text for pair in value.items() for item in pair for text in _texts(item))
    elif isinstance(value, list):
        yield from (text for item in value for text in _texts(item))
    else:
        yield value


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Yield a folder of files below which are the current folder, the home folder and paths.data, with links."""
    root = tmp_path_factory.mktemp("folders")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("here", "home", "data/inside", "elsewhere"):
            (root / name).mkdir(parents=True)
            for file in ("notes.txt", "notes", "walk.bvh", "library.h5"):
                (root / name / file).write_text("content")
        (root / "here" / "to_elsewhere").symlink_to("../elsewhere")
        (root / "data" / "to_elsewhere").symlink_to("../elsewhere")
        (root / "data" / "to_notes.txt").symlink_to("../elsewhere/notes.txt")
        patch.chdir(root / "here")
        patch.setenv("HOME", str(root / "home"))
        yield root


@pytest.fixture(scope="module")
def current(folders):
    """Return today's defaults with the data folder of `folders`."""
    return OmegaConf.merge(defaults(), {"paths": {"data": str(folders / "data")}})


PATHS = (
    "{root}/elsewhere/notes.txt", "{root}/elsewhere", "{root}/elsewhere/missing", "{root}/elsewhere/library.h5:walk",
    "../elsewhere/walk.bvh", "{root}/data/../elsewhere/notes.txt", "notes.txt", "walk.bvh", "notes", "./notes",
    "library.h5:walk", "to_elsewhere/notes.txt", "./to_elsewhere", "~/notes.txt", "~", "{root}/data/to_notes.txt",
    "{root}/data/to_elsewhere", "{root}/data/to_elsewhere/walk.bvh", "file://{root}/elsewhere/notes.txt",
    "file:{root}/elsewhere/notes.txt", "https://example.org/notes.txt", "C:\\notes.txt", "..\\notes.txt", "a\0b",
)  # fmt: skip


def _contents(root):
    files = (path for path in root.rglob("*") if path.is_file())
    return {str(path): (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


@given(st.data())
@settings(max_examples=100)
def test_no_recorded_key_names_a_place_outside(folders, current, data):
    """A path outside paths.data at any key is refused, or the user's folder replaces it; nothing is written."""
    (*parents, last), node = data.draw(st.sampled_from(recorded_keys()))
    bad = data.draw(st.sampled_from(PATHS)).format(root=folders)
    value = data.draw(st.sampled_from([bad, [bad], ["a", bad], {"a": bad}, {bad: "a"}, {"a": [bad]}]))
    config = {"seed": 3, "paths": {"data": str(folders / "data"), "cache": "/some/cache"}}
    config |= {} if node is None else {parents[0]: deepcopy(node)}
    place = config
    for key in parents:
        place = place.setdefault(key, {})
    place[last] = value
    before, run = _contents(folders), run_with(yaml.safe_dump(config))
    outcome = []
    if not refusal(lambda: outcome.append(runnable_config(run, [], current))):
        assert bad not in set(_texts(OmegaConf.to_container(outcome[0])))
    assert _contents(folders) == before


PLACES = ("source", "keypoints", "calibration_file", "initial_annotations", "eval_annotations")


@pytest.mark.parametrize("key", PLACES)
def test_a_folder_of_the_current_folder_is_refused_where_a_key_names_one(folders, key):
    node = {
        "_target_": "workbench.datasets.video.Video",
        "source": "x.mp4",
        "calibration_file": None,
        key: "to_elsewhere",
    }
    message = refusal(runnable_config, run_with(yaml.safe_dump({"seed": 3, "dataset": node})), [], defaults())
    assert message.startswith(
        f"a.rrd: dataset.{key}: 'to_elsewhere' is outside paths.data; if you trust it, add dataset."
    )


def test_a_folder_with_a_link_that_leaves_the_data_is_refused(folders, current):
    node = {"_target_": "workbench.datasets.point_files.PointFiles"}

    def refused(source):
        text = yaml.safe_dump({"seed": 3, "dataset": {**node, "source": str(folders / "data" / source)}})
        return refusal(runnable_config, run_with(text), [], current)

    assert "outside paths.data" in refused("")
    assert not refused("inside")
    assert not refused("inside/walk.bvh")


def test_a_path_as_the_key_of_a_mapping_is_refused():
    node = {"_target_": "workbench.datasets.points.Points", "motion": {"/etc/walk.bvh": "a"}}
    message = refusal(runnable_config, run_with(yaml.safe_dump({"seed": 3, "dataset": node})), [], defaults())
    assert message.startswith("a.rrd: dataset.motion./etc/walk.bvh: '/etc/walk.bvh' is outside paths.data")


def _made_from(folder, data, source):
    """Return the source of the video in the configuration of a recording in a folder, or the refusal."""
    node = {"_target_": "workbench.datasets.video.Video", "source": source, "calibration_file": None}
    text = yaml.safe_dump({"seed": 3, "dataset": node, "paths": {"data": data}})
    run = Run(folder / "a.rrd", {"config": {"TextDocument:text": text}}, {})
    configs = []
    return refusal(lambda: configs.append(runnable_config(run, [], defaults()))) or configs[0].dataset.source


def test_a_recording_made_from_inputs_reads_those_next_to_it_and_nothing_else(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own / "inputs", other):
        folder.mkdir(parents=True)
        (folder / "walk.mp4").write_text("content")
    assert _made_from(own, "/elsewhere/inputs", "/elsewhere/inputs/walk.mp4") == str(own / "inputs" / "walk.mp4")
    for data, source in (
        ("/elsewhere/data", "/elsewhere/data/walk.mp4"), ("/elsewhere/data", str(own / "inputs" / "walk.mp4")),
        ("/elsewhere/inputs", str(other / "walk.mp4")), ("/elsewhere/inputs", "/elsewhere/inputs/../../other/walk.mp4"),
    ):  # fmt: skip
        assert "outside paths.data" in _made_from(own, data, source)
    assert "outside paths.data" in _made_from(other, "/elsewhere/inputs", "/elsewhere/inputs/walk.mp4")


def test_inputs_with_a_link_are_not_read(tmp_path):
    """They may come from an archive, unlike the user's paths.data with links to databases."""
    for name in ("real", "below/inputs", "is"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "walk.mp4").write_text("content")
    (tmp_path / "below" / "inputs" / "cmu").symlink_to("../../real")
    (tmp_path / "is" / "inputs").symlink_to("../real")
    for name in ("below", "is"):
        assert "outside paths.data" in _made_from(tmp_path / name, "/elsewhere/inputs", "/elsewhere/inputs/walk.mp4")
