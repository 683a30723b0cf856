"""`workbench run`: its recording and summary, interruption and reproducibility, at small size."""

import json
import os
import signal
import subprocess
import sys
import time

import numba
import numpy as np
import pytest

from workbench.cli.main import main
from workbench.recording.read.reader import read

SMALL = ("dataset.n_frames=4", "inference.n_particles=60", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175")


@pytest.mark.parametrize("experiment", ["walk_straight", "walk_prior_only"])
@pytest.mark.slow
def test_an_experiment_writes_a_recording_and_a_summary(run, experiment):
    code, output, folder = run("out", f"experiment={experiment}", *SMALL)
    assert code == 0, output
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == "complete"
    assert (summary["experiment"], summary["seed"]) == (experiment, 0)
    needed = {"mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px", "ess_mean", "unique_ancestors_lag10", "coverage_90", "n_frames"}
    assert needed <= summary["metrics"].keys()
    assert all(np.isfinite(summary["metrics"][name]) for name in needed)
    assert summary["metrics"]["n_frames"] == 4
    assert ("effective sample size" in output) == (experiment != "walk_prior_only")  # its weights are uniform
    assert "log_evidence" not in summary["metrics"]
    assert summary["omitted_metrics"]["log_evidence"].startswith("likelihood=")
    assert "workbench view" in output
    recording = read(folder / "run.rrd")
    assert recording.poses[1].shape == (4, 25)
    assert "n_particles: 60" in recording.config
    assert summary["assumptions"] == recording.settings["assumptions"]
    assert {"initial_pose", "limb_lengths"} <= set(summary["assumptions"])
    assert recording.provenance["assumptions"] == ", ".join(summary["assumptions"])
    assert f"assumptions: {recording.provenance['assumptions']}\n" in output
    assert not list(folder.glob("*.part"))


@pytest.mark.slow
def test_a_process_ends_cleanly_during_imports_and_while_it_compiles(tmp_path):
    """SIGTERM arrives some seconds after the start or, with an empty kernel cache, 1 s after the run has begun."""
    number = signal.SIGTERM
    statuses = set()
    for k, seconds in enumerate((0.5, 3.0, None)):
        folder = tmp_path / str(k)
        environment = {**os.environ, "WORKBENCH_CACHE": str(tmp_path / "cache")}
        if seconds is None:
            environment["NUMBA_CACHE_DIR"] = str(folder)
        command = [sys.executable, "-m", "workbench", "run", "paths.data=null", "seed=1", f"hydra.run.dir={folder}"]
        with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=-1, stderr=subprocess.STDOUT) as process:
            while seconds is None and not (folder / "summary.json").is_file():
                assert process.poll() is None
                time.sleep(0.05)
            time.sleep(1.0 if seconds is None else seconds)
            process.send_signal(number)
            output = process.communicate(timeout=60)[0].decode()
        assert process.returncode in (128 + number, -number), output  # a shell reports both as 143
        assert "Traceback" not in output
        if process.returncode > 0:
            assert f"interrupted by {number.name}" in output
        if (folder / "summary.json").is_file():
            statuses.add(status := json.loads((folder / "summary.json").read_text())["status"])
            assert (status, process.returncode) == ("interrupted", 128 + number)
    assert statuses == {"interrupted"}


def test_a_run_records_the_command_that_repeats_it(run, tmp_path, capfd):
    _, _, folder = run("out", "experiment=walk_straight", "seed=3", *SMALL)
    summary = json.loads((folder / "summary.json").read_text())
    recorded = read(folder / "run.rrd").provenance
    for key in ("command", "lock", "choices", *summary["provenance"]):
        assert recorded[key] == summary["provenance"][key]
    assert recorded["identity"] == summary["identity"]
    assert summary["settings"]["seed"] == 3
    assert main(["runs", "restore", str(folder)]) == 0
    last = capfd.readouterr().out.splitlines()[-1]
    assert last.endswith(f"workbench run experiment=walk_straight seed=3 {' '.join(SMALL)}")
    conditions = ["seed=3", "prior=walking", "experiment=walk_straight", "n_particles=60"]
    assert main(["runs", "list", str(tmp_path), *conditions, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)[0]["recording"] == str(folder / "run.rrd")


def recorded_curves(folder):
    recording = read(folder / "run.rrd")
    return recording.poses[1], recording.metric("ess")[1], recording.metric("mpjpe_abs_mm")[1]


@pytest.mark.slow
def test_the_same_seed_is_bitwise_identical_at_any_number_of_threads(process, run):
    """In a new process and in one that has run other configurations; other seeds: test_inference_contract."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core only: cannot run with two threads")
    results = []
    for command, n_threads in ((process, 1), (run, 2)):
        code, output, folder = command(f"{n_threads}", *SMALL, f"n_threads={n_threads}")
        assert code == 0, output
        results.append(recorded_curves(folder))
    assert all((a == b).all() for a, b in zip(*results, strict=True))


@pytest.mark.slow
def test_a_user_s_motion_library_and_body_file_are_used(summary_of, tmp_path, data):
    clips = [str(data / "cmu" / "35" / f"35_{take}.amc") for take in ("01", "02", "07", "08", "09")]
    assert main(["import", *clips, "-o", str(tmp_path / "mine.h5")]) == 0
    prior = (
        "experiment=walk_straight",
        "prior.motions=mine.h5",
        "prior.n_components=3",
        "dataset.motion=mine.h5:35_02",
        "training.exclude=[35_02]",
    )
    metrics = summary_of(tmp_path, *prior, "body=file", f"body.file={clips[1]}", *SMALL)["metrics"]
    assert metrics["mpjpe_abs_mm"] < 200  # three frames after the true initial pose, with the true body
