"""Every run below a folder is found; what was read once is not read again; hostile folders hide nothing."""

import json
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_folders import leave, leave_sweep, summary

from workbench.results import index
from workbench.results.entry import entry_of_folder
from workbench.results.index import INDEX, entries
from workbench.utils.errors import InputError
from workbench.utils.run_lock import locked


@pytest.fixture
def root(tmp_path):
    leave_sweep(tmp_path / "sweeps" / "a")
    leave(tmp_path / "runs" / "b", day=30)
    return tmp_path


@pytest.fixture
def reads(monkeypatch):
    """The folders that were read."""
    read = []
    monkeypatch.setattr(index, "entry_of_folder", lambda folder: read.append(folder.name) or entry_of_folder(folder))
    return read


def test_runs_are_found_newest_first_with_their_sweep(root):
    found = entries(root)
    assert len(found) == 13
    assert found[0].path == str(root / "runs" / "b")
    assert found[0].sweep == ""
    assert found[1].sweep == str(root / "sweeps" / "a")
    assert found[0].started == "2026-11-30T15:00:00"
    assert entries(root, root / "runs") == found


def test_only_what_changed_is_read_again(root, reads):
    first = entries(root)
    assert len(reads) == 13
    assert entries(root) == first
    assert len(reads) == 13
    (root / "runs" / "b" / "summary.json").write_text(json.dumps(summary(day=30, error=1.0, status="failed")))
    assert entries(root)[0].metrics["error_abs_mm"] == 1.0
    assert reads[13:] == ["b"]
    shutil.rmtree(root / "runs" / "b")
    assert len(entries(root)) == 12
    assert len(json.loads((root / INDEX).read_text())["runs"]) == 12


@pytest.mark.parametrize("content", ["", "{", "[]", '{"workbench": "0"}', '{"runs": 3}', "null"])
def test_an_index_that_is_broken_is_made_again(root, content):
    first = entries(root)
    (root / INDEX).write_text(content)
    assert entries(root) == first
    assert len(json.loads((root / INDEX).read_text())["runs"]) == 13


@pytest.mark.parametrize(
    "told",
    [{"path": "/elsewhere"}, {"recording": "/elsewhere/run.rrd"}, {"metrics": {"error_abs_mm": "1"}}, {"settings": 3},
     {"choices": {"prior": 1}}, {"unknown": 1}],
)  # fmt: skip
def test_what_an_index_says_that_is_not_of_its_run_is_read_again(root, told):
    first = entries(root)
    index = json.loads((root / INDEX).read_text())
    for _, fields, names in index["runs"].values():
        fields |= told
        names[:] = []  # of what is shared nothing is left to say
    (root / INDEX).write_text(json.dumps(index))
    assert entries(root) == first


def test_what_all_runs_have_in_common_is_written_once(root):
    leave(root / "other", settings={"seed": 0}, provenance={})
    first = entries(root)
    assert (root / INDEX).read_text().count("edges") == 1
    assert entries(root) == first


def test_a_run_that_another_command_removes_meanwhile_is_not_there(root, monkeypatch):
    def gone(folder):
        shutil.rmtree(folder)
        return entry_of_folder(folder)

    monkeypatch.setattr(index, "entry_of_folder", gone)
    assert entries(root / "sweeps") == []


def test_an_index_that_was_moved_with_its_folder_is_made_again(root):
    entries(root)
    moved = root.rename(root.with_name(root.name + "_moved"))
    assert all(entry.path.startswith(str(moved)) for entry in entries(moved))


def test_a_folder_that_cannot_be_written_is_read_all_the_same(root, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert len(entries(root)) == 13
    assert not (root / INDEX).exists()


def test_a_run_without_a_process_at_work_was_killed(tmp_path):
    leave(tmp_path / "a", status="running")
    assert entries(tmp_path)[0].status == "killed"
    with locked(tmp_path / "a"):
        assert entries(tmp_path)[0].status == "running"


_LEAVES = st.none() | st.floats() | st.text(max_size=5)
_KEYS = st.sampled_from(list(summary()))
JSON = st.recursive(
    _LEAVES, lambda of: st.lists(of, max_size=3) | st.dictionaries(_KEYS, of, max_size=6), max_leaves=20
)


@given(content=st.text(max_size=40) | JSON.map(json.dumps))
def test_whatever_a_summary_says_the_runs_beside_it_are_found(tmp_path_factory, content):
    root = tmp_path_factory.mktemp("hostile")
    leave(root / "good")
    (root / "bad").mkdir()
    (root / "bad" / "summary.json").write_text(content, encoding="utf-8", errors="surrogatepass")
    found = {entry.path: entry for entry in entries(root)}
    assert found[str(root / "good")].status == "complete"
    assert len(found) == 2
    assert found[str(root / "bad")].status == "unreadable" or content.startswith("{")


def test_what_is_not_there_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="expected a folder of runs or a recording"):
        entries(tmp_path / "none")


def test_a_recording_that_is_removed_meanwhile_is_a_sentence(tmp_path, monkeypatch):
    (recording := tmp_path / "a.rrd").touch()
    isdir = os.path.isdir
    monkeypatch.setattr(os.path, "isdir", lambda path: recording.unlink(missing_ok=True) or isdir(path))
    with pytest.raises(InputError, match=r"a\.rrd: expected a folder of runs or a recording, found nothing there"):
        entries(recording)


def test_where_there_is_no_room_for_an_index_the_runs_are_found_all_the_same(root, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    first = entries(root)
    (root / INDEX).unlink()
    monkeypatch.setattr(Path, "write_text", full)
    assert entries(root) == first
    assert sorted(os.listdir(root)) == ["runs", "sweeps"]
