"""`workbench report` writes tables, plots and a self-contained page of the recordings in a folder."""

import base64
import csv
import json
import re
import shutil

import numpy as np
import pytest
from html_page import Page
from recording_steps import BODY, SPACE, errors, steps, without_images

from workbench.body.kinematics import joints
from workbench.cli.main import main
from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder
from workbench.results.report.page import escaped
from workbench.results.report.plots import joint_errors

PLOTS = ["coverage_90", "error_against_particles", "error_against_time", "error_per_joint"]


def config(prior, n, seed):
    inference = {"n_particles": n}
    return json.dumps({"prior": {"_target_": f"workbench.priors.{prior}"}, "inference": inference, "seed": seed})


def record(folder, run, prior="walking", n=100, seed=0, error=10.0, exception=None):
    """Record these steps, after which `exception` is raised if there is one."""
    path = folder / f"{prior}_{n}_{seed}" / "run.rrd"
    labels = {"run_id": str(path), "config_yaml": config(prior, n, seed), "provenance": {"experiment": "custom"}}
    with Recorder(path, BODY, SPACE, **labels) as recording:
        for step in run:
            recording.log(step, errors(step))
        if exception is not None:
            raise exception
        recording.set_result({"mpjpe_abs_mm": error, "coverage_90": 0.8, "ess_mean": 5.0})
        recording.set_cost({"seconds": n / 100.0, "likelihood_evaluations": n * len(run)})
    return path


@pytest.fixture(scope="module")
def run():
    return without_images(steps(4, n_particles=20))


@pytest.fixture(scope="module")
def sweep(run, tmp_path_factory):
    """Two priors, two numbers of particles, two seeds; an interrupted and a killed run, and a damaged recording."""
    folder = tmp_path_factory.mktemp("reports") / "sweep"
    for k, (prior, n, seed) in enumerate((p, n, s) for p in ("walking", "smooth") for n in (100, 400) for s in (0, 1)):
        record(folder, run, prior, n, seed, error=10.0 + k)
    with pytest.raises(KeyboardInterrupt):
        record(folder, run, seed=2, exception=KeyboardInterrupt())
    labels = {"run_id": "killed", "config_yaml": config("smooth", 400, 2), "provenance": {"experiment": "custom"}}
    with Recorder(folder / "killed" / "run.rrd", BODY, SPACE, **labels) as recording:
        shutil.copy(recording.part, folder / "killed.rrd.part")
    shutil.rmtree(folder / "killed")
    (folder / "junk.rrd").write_bytes(b"no recording" * 100)
    return folder


@pytest.fixture(scope="module")
def written(sweep, tmp_path_factory):
    """The folder of the report on the sweep."""
    folder = tmp_path_factory.mktemp("written") / "report"
    with pytest.MonkeyPatch.context() as patch:  # read the recordings without the sandbox
        patch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda paths: set())
        assert main(["report", str(sweep), "-o", str(folder)]) == 0
    return folder


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_tables_contain_unrounded_numbers(written):
    expected = [*(f"{name}.png" for name in PLOTS), "report.csv", "report.html", "report.md", "runs.csv"]
    assert sorted(path.name for path in written.iterdir()) == sorted(expected)
    groups = {(row["group"], row["metric"]): row for row in rows_of(written / "report.csv")}
    row = groups["walking, n_particles=100", "mpjpe_abs_mm"]
    assert [row[key] for key in ("prior", "n_particles", "n")] == ["walking", "100", "2"]
    assert [float(row[key]) for key in ("mean", "sd", "low_95", "high_95")] == [10.5, np.sqrt(0.5), 10.0, 11.0]
    assert len(groups) == 4 * 5
    runs = {(row["group"], row["seed"], row["metric"]): row["value"] for row in rows_of(written / "runs.csv")}
    assert len(runs) == 8 * 5
    assert float(runs["smooth, n_particles=400", "1", "mpjpe_abs_mm"]) == 17.0
    assert float(runs["smooth, n_particles=400", "1", "likelihood_evaluations"]) == 1600.0


def test_the_page_is_self_contained(written):
    page = Page((written / "report.html").read_text())
    tags = [tag for tag, _ in page.tags]
    assert not {"script", "link", "iframe", "object", "embed"} & set(tags)
    addresses = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert all(address.startswith("data:image/png;base64,") for address in addresses)
    images = [base64.b64decode(address.partition(",")[2]) for address in addresses]
    assert sorted(images) == sorted((written / f"{name}.png").read_bytes() for name in PLOTS)
    policy = next(attributes["content"] for _, attributes in page.tags if attributes.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    assert "http" not in (written / "report.html").read_text().replace("http-equiv", "")
    for text in ("Report on sweep", "walking, n_particles=400", "ess_mean", "junk.rrd"):
        assert text in page.text


def test_a_report_without_matplotlib_has_all_but_the_plots(sweep, written, tmp_path, trusted, monkeypatch, capsys):
    monkeypatch.setattr("workbench.cli.report.can_draw", lambda: False)
    assert main(["report", str(sweep), "-o", str(tmp_path)]) == 0
    assert "[plots]" in capsys.readouterr().err
    expected = {path.name for path in written.iterdir() if path.suffix != ".png"}
    assert {path.name for path in tmp_path.iterdir()} == expected
    assert (tmp_path / "report.csv").read_bytes() == (written / "report.csv").read_bytes()


@pytest.mark.slow
def test_reports_are_reproducible_bitwise(sweep, written, tmp_path):
    assert main(["report", str(sweep), "-o", str(tmp_path)]) == 0
    for path in written.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_joint_errors_are_mean_distances_after_the_first_frame(sweep, run):
    errors_mm = joint_errors(read(sweep / "walking_100_0" / "run.rrd"))
    differences = [joints(BODY.skeleton, step.expected_pose[None])[0] - step.frame.truth.joints for step in run[1:]]
    expected = 1e3 * np.linalg.norm(differences, axis=2).mean(axis=0)
    assert tuple(errors_mm) == BODY.skeleton.names
    np.testing.assert_allclose(list(errors_mm.values()), expected, atol=1e-3)  # positions are float32, in metres


def test_markup_in_recordings_is_escaped(run, tmp_path, capsys):
    for name in ("<script>alert(1)</script>", "a|b`*\x1b[2J"):
        folder = tmp_path / "in" / str(len(name))
        labels = {"run_id": name, "config_yaml": json.dumps({"seed": 0, "body": {"name": name}}), "provenance": {}}
        with Recorder(folder / "run.rrd", BODY, SPACE, **labels) as recording:
            recording.set_result({"mpjpe_abs_mm": 1.0, name: 2.0})
    assert main(["report", str(tmp_path / "in"), "-o", str(tmp_path / "out")]) == 0
    assert "name=a|b`* [2J" in capsys.readouterr().out
    page = Page((tmp_path / "out" / "report.html").read_text())
    assert "script" not in [tag for tag, _ in page.tags]
    assert "name=<script>alert(1)</script>" in page.text
    tables = [line for line in (tmp_path / "out" / "report.md").read_text().splitlines() if line.startswith("| name=")]
    assert all("<" not in line.replace("\\<", "") for line in tables)
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in tables} == {7, 9}  # tables of runs and of metrics
    assert escaped("two\nlines [x](y) \\") == "two lines \\[x\\](y) \\\\"


def test_folders_without_recordings_and_invalid_outputs_are_rejected(sweep, tmp_path, capsys):
    def message(*arguments):
        assert main(["report", *(str(argument) for argument in arguments)]) == 2
        return capsys.readouterr().err

    assert "expected recordings (.rrd, .rrd.part), found none" in message(tmp_path)
    assert "missing" in message(tmp_path / "missing")
    (tmp_path / "file").write_text("existing")
    assert f"{tmp_path / 'file'}" in message(sweep / "walking_100_0", "-o", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "existing"
