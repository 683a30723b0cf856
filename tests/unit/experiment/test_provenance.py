"""What a run comes from is recorded so that it can be brought back."""

import subprocess

import pytest
from omegaconf import OmegaConf

from workbench.experiment import provenance as module
from workbench.experiment.provenance import CUT, code_state, has_commit, input_files


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


def test_a_long_difference_is_cut_and_says_so(clone, monkeypatch):
    monkeypatch.setattr(module, "MOST_CHANGED", 100)
    (clone / "workbench" / "a.py").write_text("two\n" * 1000)
    assert code_state(clone)["difference"].endswith(CUT)
    assert len(code_state(clone)["difference"]) == 100 + len(CUT)


def test_a_folder_inside_somebody_elses_clone_is_none(clone):
    (clone / "inner").mkdir()
    assert code_state(clone / "inner") == {}


def test_inputs_are_the_files_that_are_named(tmp_path):
    (tmp_path / "walk.bvh").write_text("one")
    config = OmegaConf.create({"dataset": {"motion": str(tmp_path / "walk.bvh"), "n": 3}, "paths": {"data": None}})
    first = input_files(config)
    assert list(first) == [str(tmp_path / "walk.bvh")]
    (tmp_path / "walk.bvh").write_text("another")
    assert input_files(config) != first
