"""Recordings of earlier formats are read, compared, listed, reported and shown with the current names."""

import json
import shutil
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from workbench.cli.main import main
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.recording import migrations
from workbench.recording.migrations import (
    FORMAT,
    entity_path,
    metric_name,
    renamed,
    renamed_properties,
    renamed_summary,
    with_level,
)
from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import read
from workbench.recording.side_by_side import write_side_by_side
from workbench.results.check.agreement import Agreement
from workbench.results.check.rerun import Request, check_two
from workbench.results.table import read_runs

BASELINES = Path(__file__).parents[2] / "recordings" / "baselines"
FORMAT_1 = Path(__file__).parents[1] / "unit" / "recording" / "recordings" / "format_1.rrd"
TRACKED = {1: FORMAT_1, 2: BASELINES / "walk_circle.rrd"}
STUDIES = {2: BASELINES / "learn_walk.rrd"}
RECORDINGS = [*TRACKED.items(), *STUDIES.items()]


@pytest.mark.parametrize(("version", "path"), RECORDINGS, ids=lambda value: str(getattr(value, "stem", value)))
def test_recordings_of_earlier_formats_have_the_current_names(version, path):
    run = read(path)
    assert (run.format, run.status) == (version, "complete")
    for names in (run.metrics, run.result, run.properties.get("cost", {})):
        assert [metric_name(name) for name in names] == list(names)
    assert renamed_properties(run.properties) == run.properties
    assert renamed(run.settings) == run.settings
    assert {"given", "figures"}.isdisjoint({*run.settings, *run.settings.get("check", {}), *run.provenance})
    paths = {chunk.entity_path for chunk in read_chunks(path, EVERYTHING)}
    assert {entity_path(path) for path in paths} == paths


@pytest.mark.parametrize("path", TRACKED.values(), ids=TRACKED)
def test_metrics_keep_their_recorded_values(path):
    run = read(path)
    assert {"mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px", "mpjpe_px_max_weight", "ess"} <= run.metrics.keys()
    frames, errors = run.metric("mpjpe_abs_mm")
    assert frames.tolist() == run.poses[0].tolist()
    assert errors[1:].mean() == pytest.approx(run.result["mpjpe_abs_mm"])
    assert "metrics/mpjpe_abs_mm" in run.scalars


@pytest.mark.parametrize(("version", "path"), RECORDINGS, ids=lambda value: str(getattr(value, "stem", value)))
def test_a_recording_is_identical_to_its_copy_in_the_current_format(version, path, tmp_path):
    """`workbench check` compares the recording with a copy that has the current names and format."""
    old, new = read(path), tmp_path / "new.rrd"
    write_renamed(path, new)
    assert read(new).format == FORMAT
    own = current_defaults(["paths.data=null", "paths.cache=/some/cache"])
    check = check_two("x", old, read(new), Request([], own, tmp_path))
    assert check.passed
    assert len(check.findings) > 3
    assert {finding.agreement for finding in check.findings} == {Agreement.IDENTICAL}
    prepare_hydra()
    if version == 2:
        assert runnable_config(old, [], own).paths.cache == "/some/cache"


def write_renamed(path, new):
    """Write a copy of a recording with the current paths, properties and format."""
    import rerun as rr

    from workbench.recording.read.chunks import recording_of, static_values
    from workbench.recording.write.file import arrow, new_stream

    chunks = [chunk for chunk in read_chunks(path, EVERYTHING) if not chunk.entity_path.startswith("/__properties/")]
    marginals = [chunk for chunk in read_chunks(path, ["/__properties/**"]) if chunk.entity_path.endswith("/marginals")]
    stream = new_stream(*recording_of(path), send_properties=False)
    stream.set_sinks(rr.FileSink(new))
    stream.send_chunks([*chunks, *marginals])
    run = read(path)
    for name, values in run.properties.items():
        if name not in ("config", "marginals"):
            stream.send_property(name, arrow(values | ({"format": FORMAT} if name == "run" else {})))
    config = json.dumps(run.settings)
    stream.send_property("config", rr.TextDocument(config, media_type="text/plain"))
    assert static_values(marginals).keys() <= {"__properties/marginals"}
    stream.flush()
    stream.disconnect()


@pytest.mark.slow
def test_recordings_of_earlier_formats_are_listed_and_reported(tmp_path, capsys):
    for version, path in TRACKED.items():
        shutil.copy(path, tmp_path / f"format_{version}.rrd")
    runs = read_runs(tmp_path)
    assert runs["metrics.mpjpe_abs_mm"].notna().all()
    assert not any(name.rpartition(".")[2].startswith("error_") for name in runs)
    assert main(["runs", "list", str(tmp_path), "mpjpe_abs_mm<1e9", "--columns", "mpjpe_px"]) == 0
    assert "mpjpe_px" in capsys.readouterr().out
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "report")]) == 0
    assert "absolute MPJPE" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


def test_recordings_of_earlier_formats_are_shown_side_by_side(tmp_path):
    write_side_by_side(tmp_path / "both.rrd", *map(read, TRACKED.values()))
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "both.rrd").stream().to_chunks()}
    assert {"/a/metrics/mpjpe_abs_mm", "/b/metrics/mpjpe_abs_mm"} <= paths


def test_a_verdict_without_a_level_gets_the_level_of_its_kind():
    levels = {"tracked": "not evaluated", "lost": "not usable", "height mismatch": "doubtful"}
    for kind, level in levels.items():
        assert with_level({"verdict": {"kind": kind}})["verdict"] == {"level": level, "kind": kind}
        assert renamed_summary({"format": FORMAT, "verdict": {"kind": kind}})["verdict"]["level"] == level
    current = {"verdict": {"level": "trustworthy", "kind": "lost"}, "metrics": {}}
    assert with_level(current) == current
    assert with_level({"metrics": {}}) == {"metrics": {}}


def test_a_summary_of_an_earlier_format_gets_the_current_fields():
    recorded = {
        "status": "complete", "counted": {"a": 1}, "left_out": {}, "anew": "x", "given": ["start"],
        "metrics": {"error_px": 1.0, "held": 1.0, "frames": 3.0, "doubt_arms_mm": 2.0, "compiling_s": 1.0},
        "verdict": {"kind": "held", "sentence": "held: x", "found": []}, "provenance": {"given": "start"},
        "settings": {"given": ["start"], "check": {"figures": {"absolute": 0.0}, "error_px": {}}},
    }  # fmt: skip
    summary = renamed_summary(recorded)
    assert summary["metrics"].keys() == {"mpjpe_px", "tracked", "n_frames", "expected_error_arms_mm", "compile_s"}
    assert {"input_counts", "omitted_metrics", "restart_reason", "assumptions"} <= summary.keys()
    assert summary["verdict"] == {"level": "not evaluated", "kind": "tracked", "message": "held: x", "findings": []}
    assert summary["settings"]["check"].keys() == {"study_metrics", "mpjpe_px"}
    assert renamed_summary(summary | {"format": FORMAT}) == summary | {"format": FORMAT}


@pytest.mark.parametrize("table", ["_METRICS", "_PATHS", "_VERDICTS", "_SUMMARY", "_SETTINGS", "_PROPERTIES"])
def test_no_current_name_is_an_earlier_one(table):
    names = getattr(migrations, table)
    assert names.keys().isdisjoint(names.values())
    assert len({*names.values()}) == len(names)
