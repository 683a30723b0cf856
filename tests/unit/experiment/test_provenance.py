"""What a run comes from is recorded so that it can be repeated; equal identities are equal runs."""

import dataclasses
import hashlib
import shutil
import subprocess

import numpy as np
import pytest
from omegaconf import OmegaConf

from workbench.core.keys import constructor_arguments, records_arguments
from workbench.experiment import provenance as module
from workbench.experiment.provenance import code_state, has_commit, identity, object_config
from workbench.likelihoods.keypoints import Keypoints
from workbench.priors.smooth import Smooth


def git(folder, *arguments):
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    return subprocess.run(["git", "-C", folder, *who, *arguments], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def clone(tmp_path):
    """A small clone with one commit."""
    git(tmp_path, "init", "-q")
    for name in ("workbench/a.py", "conf/a.yaml", "README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("one\n")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    code_state.cache_clear()
    yield tmp_path
    code_state.cache_clear()


def test_a_clean_clone_is_its_commit(clone):
    assert code_state(clone) == {"commit": git(clone, "rev-parse", "HEAD").strip(), "changed": "no"}
    assert has_commit(clone, code_state(clone)["commit"])
    assert not has_commit(clone, "0" * 40)


def test_the_difference_brings_changed_and_new_code_back(clone, tmp_path_factory):
    (clone / "workbench" / "a.py").write_text("two\n")
    (clone / "conf" / "new.yaml").write_text("three\n")
    (clone / "README.md").write_text("no code\n")
    state = code_state(clone)
    assert state["changed"] == "yes"
    assert "README" not in state["difference"]
    other = tmp_path_factory.mktemp("other") / "clone"
    subprocess.run(["git", "clone", "-q", clone, other], check=True)
    subprocess.run(["git", "-C", other, "apply"], input=state["difference"], text=True, check=True)
    assert (other / "workbench" / "a.py").read_text() == "two\n"
    assert (other / "conf" / "new.yaml").read_text() == "three\n"


def test_a_folder_inside_somebody_elses_clone_is_none(clone):
    (clone / "inner").mkdir()
    assert code_state(clone / "inner") == {}


def config(**changes):
    """A configuration of two parts, with changes by dotted key written with __."""
    made = OmegaConf.create(
        {
            "seed": 0,
            "n_threads": None,
            "paths": {"data": None, "cache": "/somewhere/cache"},
            "check": {"default": {"absolute": 0.0}},
            "recorder": {"stream": False},
            "dataset": {"motion": "builtin", "data": "${paths.data}", "cache": "${paths.cache}", "n_frames": 5},
            "prior": {"motions": "builtin", "data": "${paths.data}", "sigma": [0.1, 0.2]},
        }
    )
    for key, value in changes.items():
        OmegaConf.update(made, key.replace("__", "."), value)
    return made


@pytest.fixture
def data(tmp_path):
    """A folder with recordings; what is in the files does not matter here."""
    folder = tmp_path / "data"
    for name in ("cmu/index.csv", "cmu/35/35.asf", "cmu/35/35_02.amc", "cmu/35/35_03.amc", "bandai/dataset-1/a.bvh"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"content of {name}")
    return folder


@pytest.mark.parametrize(
    "changes",
    [
        {"n_threads": 2},
        {"paths__cache": "/elsewhere"},
        {"paths__data": "/nothing/there"},
        {"recorder__stream": True},
        {"check__default__absolute": 1.0},
    ],
)
def test_where_and_how_it_is_run_does_not_count(changes):
    assert identity(config(**changes)) == identity(config())


@pytest.mark.parametrize(
    "changes",
    [{"seed": 1}, {"dataset__n_frames": 6}, {"dataset__motion": "35_02"}, {"prior__sigma": [0.2, 0.1]}],
)
def test_what_is_run_counts(changes):
    assert identity(config(**changes)) != identity(config())


def test_another_code_is_another_run(monkeypatch):
    before = identity(config())
    monkeypatch.setattr(module, "_code", lambda _: "other")
    assert identity(config()) != before


@pytest.mark.parametrize("form", ["{}", "{}:walk"])
def test_a_file_is_its_content_wherever_it_lies(tmp_path, form):
    here, there = tmp_path / "motions.h5", tmp_path / "there" / "motions.h5"
    here.write_text("one")
    there.parent.mkdir()
    shutil.copy(here, there)
    before = identity(config(dataset__motion=form.format(here)))
    assert identity(config(dataset__motion=form.format(there))) == before
    here.write_text("two")
    assert identity(config(dataset__motion=form.format(here))) != before


def test_a_folder_is_what_is_in_it(tmp_path):
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "0.csv").write_text("one")
    seen = [identity(config(dataset__motion=str(tmp_path / "points")))]
    (tmp_path / "points" / "1.csv").write_text("two")
    seen.append(identity(config(dataset__motion=str(tmp_path / "points"))))
    (tmp_path / "points" / "1.csv").write_text("owt")  # as long as before
    seen.append(identity(config(dataset__motion=str(tmp_path / "points"))))
    assert len(set(seen)) == 3


@pytest.mark.parametrize(
    ("changes", "read", "not_read"),
    [
        ({"dataset__motion": "35_02"}, "cmu/35/35_02.amc", "cmu/35/35_03.amc"),
        ({"dataset__motion": "35_02"}, "cmu/35/35.asf", "bandai/dataset-1/a.bvh"),
        ({"prior__motions": "cmu"}, "cmu/35/35_03.amc", "bandai/dataset-1/a.bvh"),
        ({"prior__motions": "recorded"}, "bandai/dataset-1/a.bvh", None),
        ({"dataset__motion": ["builtin", "35_03"]}, "cmu/index.csv", "cmu/35/35_02.amc"),
    ],
)
def test_recordings_named_without_a_path_are_looked_up(data, changes, read, not_read):
    named = config(paths__data=str(data), **changes)
    before = identity(named)
    if not_read is not None:
        (data / not_read).write_text("changed")
        assert identity(named) == before
    (data / read).write_text("changed")
    assert identity(named) != before


class Forgetful:
    """A part of a stranger's that keeps one of its keys."""

    def __init__(self, *, kept: float = 1.0, spent: float = 2.0) -> None:
        self.kept = kept


def test_keys_are_those_that_the_object_has_now():
    prior = Smooth(damping=2.0)
    found = object_config(prior)
    assert found["_target_"] == "workbench.priors.smooth.Smooth"
    assert (found["damping"], found["initial_pose_scale"], found["lower"]) == (2.0, 2.0, None)
    assert "not_stored" not in found


def test_a_key_that_is_not_kept_is_not_made_up():
    assert object_config(Forgetful(kept=3.0)) == {
        "_target_": f"{__name__}.Forgetful", "kept": 3.0, "not_stored": ["spent"],
    }  # fmt: skip


def test_arrays_are_written_out_or_identified():
    @dataclasses.dataclass
    class Model:
        few: np.ndarray
        many: np.ndarray

    many = np.arange(200.0).reshape(20, 10)
    found = object_config(Model(np.arange(3), many))
    assert found["few"] == [0, 1, 2]
    assert found["many"] == f"20×10, sha256 {hashlib.sha256(many.tobytes()).hexdigest()}"
    assert object_config(Model(np.arange(3), many + 1.0))["many"] != found["many"]


def test_a_decorated_class_keeps_what_it_was_built_with():
    part = records_arguments(type("Own", (Forgetful,), {}))(spent=5.0)
    assert constructor_arguments(part) == {"kept": 1.0, "spent": 5.0}
    assert object_config(part)["spent"] == 5.0
    assert constructor_arguments(Keypoints) == {}
