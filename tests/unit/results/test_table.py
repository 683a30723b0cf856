"""Every run below a folder is a row of the table, also next to invalid summaries."""

import json
import os
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_folders import summary, write_run, write_sweep
from small_recordings import write_recorded_run

import workbench as wb
from workbench.recording.format import FORMAT
from workbench.results.table import FIELDS, read_run, read_runs, records_of
from workbench.utils.errors import InputError
from workbench.utils.run_files import read_summary
from workbench.utils.run_lock import locked


@pytest.fixture
def root(tmp_path):
    write_sweep(tmp_path / "sweeps" / "a")
    write_run(tmp_path / "runs" / "b", prior="implicit", status="failed", error=400.0, day=30)
    return tmp_path


def test_runs_are_listed_newest_first_with_their_sweep(root):
    runs = read_runs(root, root / "runs")
    assert len(runs) == 13
    assert runs["path"][0] == str(root / "runs" / "b")
    assert list(runs["sweep"][:2]) == ["", str(root / "sweeps" / "a")]
    assert runs["started"][0] == "2026-11-30T15:00:00"


def test_rows_are_flat_and_records_nested(root):
    runs = read_runs(root)
    assert runs["settings.inference.n_particles"][0] == 500
    record = records_of(runs)[0]
    assert record["metrics"] == {"mpjpe_abs_mm": 400.0, "coverage_90": 0.9}  # log_evidence is null
    assert (record["choices"]["prior"], record["origin"]["commit"]) == ("implicit", "c" * 40)
    assert record["settings"]["likelihood.weights.edges"] == 0.5


def test_the_python_interface_returns_a_data_frame_with_short_names(root, monkeypatch):
    runs = wb.runs(root)
    assert list(runs)[: len(FIELDS)] == list(FIELDS)
    assert list(runs["prior"][:2]) == ["implicit", "walking"]
    assert runs["mpjpe_abs_mm"][0] == 400.0
    assert runs.groupby("prior")["mpjpe_abs_mm"].mean()["smooth"] == 12.5
    assert runs["inference.n_particles"].max() == 500
    monkeypatch.chdir(root)
    with pytest.raises(InputError, match="recordings: expected a folder of runs"):
        wb.runs()
    write_run(root / "recordings" / "a")
    assert list(wb.runs()["path"]) == ["recordings/a"]


@pytest.mark.usefixtures("trusted")
def test_a_recording_without_summary_is_a_run(tmp_path):
    write_recorded_run(tmp_path / "a", "a", experiment="arm_twist")
    assert list(read_runs(tmp_path)["path"]) == [str(tmp_path / "a")]
    (tmp_path / "a" / "summary.json").unlink()
    (tmp_path / "junk.rrd").write_bytes(b"no recording")
    junk, valid = records_of(read_runs(tmp_path / "a" / "run.rrd", tmp_path / "junk.rrd"))
    assert (valid["status"], valid["experiment"], valid["metrics"]["mpjpe_abs_mm"]) == ("complete", "arm_twist", 40.0)
    assert (junk["status"], junk["error"]) == ("unreadable", read_run(tmp_path / "junk.rrd")["error"])


def test_a_running_run_without_a_process_is_killed(tmp_path):
    write_run(tmp_path / "a", status="running")
    assert list(read_runs(tmp_path)["status"]) == ["killed"]
    with locked(tmp_path / "a"):
        assert list(read_runs(tmp_path)["status"]) == ["running"]


def test_a_run_removed_while_it_is_read_is_omitted(root, monkeypatch):
    folder = root / "runs" / "b"
    monkeypatch.setattr(json, "loads", lambda text: shutil.rmtree(folder))
    assert read_run(folder) is None
    assert not folder.exists()


_LEAVES = st.none() | st.floats() | st.text(max_size=5)
_KEYS = st.sampled_from(list(summary())) | st.just("\ud800")
JSON = st.recursive(
    _LEAVES, lambda values: st.lists(values, max_size=3) | st.dictionaries(_KEYS, values, max_size=6), max_leaves=20
)


SUMMARIES = JSON.map(lambda value: json.dumps(summary(settings=value)))


@given(content=st.text(max_size=40) | JSON.map(json.dumps) | SUMMARIES)
def test_any_content_of_a_summary_leaves_the_other_runs_readable(tmp_path_factory, content):
    root = tmp_path_factory.mktemp("hostile")
    write_run(root / "valid")
    (root / "invalid").mkdir()
    (root / "invalid" / "summary.json").write_text(content, encoding="utf-8", errors="surrogatepass")
    status = read_runs(root).set_index("path")["status"]
    assert len(status) == 2
    assert status[str(root / "valid")] == "complete"
    assert status[str(root / "invalid")] == "unreadable" or content.startswith("{")


def test_a_summary_of_another_format_is_refused_with_the_version_that_wrote_it(tmp_path):
    write_run(tmp_path / "old", format=2, versions={"workbench": "0.0.1"})
    (row,) = read_runs(tmp_path).to_dict("records")
    assert row["status"] == "unreadable"
    assert row["error"] == (
        f"{tmp_path}/old/summary.json: expected format {FORMAT}, found format 2, written by workbench 0.0.1; "
        "repeat its experiment, or use that version"
    )


@pytest.mark.parametrize("kind", ["a pipe", "a device", "a folder"])
def test_a_summary_that_is_no_file_is_not_opened(tmp_path, kind):
    path = tmp_path / "summary.json"
    make = {"a pipe": os.mkfifo, "a device": lambda path: path.symlink_to("/dev/zero"), "a folder": os.mkdir}
    make[kind](path)
    assert read_summary(tmp_path) is None
    assert "expected a file" in read_run(tmp_path)["error"]
