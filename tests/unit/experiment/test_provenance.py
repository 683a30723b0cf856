"""Provenance records what a run needs to be repeated; runs with equal identities are equal."""

import shutil
import subprocess

import pytest
from omegaconf import OmegaConf

from workbench.experiment import provenance as module
from workbench.experiment.provenance import code_state, has_commit, identity


def git(folder, *arguments):
    author = ["-c", "user.name=a", "-c", "user.email=a@b"]
    return subprocess.run(["git", "-C", folder, *author, *arguments], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def clone(tmp_path):
    """Yield a small repository with one commit."""
    git(tmp_path, "init", "-q")
    for name in ("workbench/a.py", "conf/a.yaml", "README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("one\n")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    code_state.cache_clear()
    yield tmp_path
    code_state.cache_clear()


def test_a_clean_clone_is_described_by_its_commit(clone):
    assert code_state(clone) == {"commit": git(clone, "rev-parse", "HEAD").strip(), "changed": "no"}
    assert has_commit(clone, code_state(clone)["commit"])
    assert not has_commit(clone, "0" * 40)


def test_the_difference_restores_changed_and_new_code(clone, tmp_path_factory):
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


def test_a_folder_inside_another_clone_has_no_code_state(clone):
    (clone / "inner").mkdir()
    assert code_state(clone / "inner") == {}


def config(**changes):
    """Return a configuration of two components; keys of changes have __ for dots."""
    settings = OmegaConf.create(
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
        OmegaConf.update(settings, key.replace("__", "."), value)
    return settings


@pytest.fixture
def data(tmp_path):
    """Return a folder with files of recordings, whose contents have no meaning."""
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
def test_places_and_resources_do_not_change_the_identity(changes):
    assert identity(config(**changes)) == identity(config())


@pytest.mark.parametrize(
    "changes", [{"seed": 1}, {"dataset__n_frames": 6}, {"dataset__motion": "35_02"}, {"prior__sigma": [0.2, 0.1]}]
)
def test_settings_change_the_identity(changes):
    assert identity(config(**changes)) != identity(config())


def test_changed_code_changes_the_identity(monkeypatch):
    before = identity(config())
    monkeypatch.setattr(module, "_code", lambda _: "other")
    assert identity(config()) != before


@pytest.mark.parametrize("form", ["{}", "{}:walk"])
def test_a_file_is_identified_by_its_contents(tmp_path, form):
    here, there = tmp_path / "motions.h5", tmp_path / "there" / "motions.h5"
    here.write_text("one")
    there.parent.mkdir()
    shutil.copy(here, there)
    before = identity(config(dataset__motion=form.format(here)))
    assert identity(config(dataset__motion=form.format(there))) == before
    here.write_text("two")
    assert identity(config(dataset__motion=form.format(here))) != before


def test_a_folder_is_identified_by_its_contents(tmp_path):
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "0.csv").write_text("one")
    identities = [identity(config(dataset__motion=str(tmp_path / "points")))]
    (tmp_path / "points" / "1.csv").write_text("two")
    identities.append(identity(config(dataset__motion=str(tmp_path / "points"))))
    (tmp_path / "points" / "1.csv").write_text("owt")  # of the same length
    identities.append(identity(config(dataset__motion=str(tmp_path / "points"))))
    assert len(set(identities)) == 3


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
def test_recordings_are_identified_by_the_contents_of_their_files(data, changes, read, not_read):
    named = config(paths__data=str(data), **changes)
    before = identity(named)
    if not_read is not None:
        (data / not_read).write_text("changed")
        assert identity(named) == before
    (data / read).write_text("changed")
    assert identity(named) != before
