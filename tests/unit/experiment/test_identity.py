"""Two runs have one identity exactly when they would come out the same: configuration, code, content of files."""

import shutil

import pytest
from omegaconf import OmegaConf

from workbench.experiment import provenance as module
from workbench.experiment.provenance import identity


def config(**changes):
    """A configuration of two parts, with changes by dotted key written with __."""
    made = OmegaConf.create(
        {
            "seed": 0,
            "threads": None,
            "paths": {"data": None, "cache": "/somewhere/cache"},
            "check": {"default": {"absolute": 0.0}},
            "recorder": {"live": False},
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
        {"threads": 2},
        {"paths__cache": "/elsewhere"},
        {"paths__data": "/nothing/there"},
        {"recorder__live": True},
        {"check__default__absolute": 1.0},
    ],
)
def test_where_and_how_it_is_run_does_not_count(changes):
    assert identity(config(**changes)) == identity(config())


def test_a_text_that_is_too_long_for_a_file_is_none(data):
    long = [config(dataset__motion=10 * "a walk with a load, " + 100 * end, paths__data=str(data)) for end in "ab"]
    assert identity(long[0]) != identity(long[1])


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


def test_the_same_recordings_in_another_folder_are_the_same(data, tmp_path):
    moved = shutil.copytree(data, tmp_path / "moved")
    found = [identity(config(paths__data=str(place), prior__motions="cmu")) for place in (data, moved)]
    assert found[0] == found[1]
