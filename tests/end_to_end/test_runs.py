"""Whole runs through the command line, at small size."""

import json
import logging
import os
import subprocess
import sys

import numpy as np
import pytest

from workbench.cli.import_motions import main as import_motions
from workbench.cli.run import main
from workbench.recording.reader import read

SMALL = ("dataset.n_frames=4", "inference.n_particles=60", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175")


def workbench(tmp_path, *overrides, cache=None, check=True):
    """Run the command in an empty folder; returns the finished process."""
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache or tmp_path / "cache")}
    environment.pop("WORKBENCH_DATA", None)
    done = subprocess.run(
        [sys.executable, "-m", "workbench", *overrides, f"hydra.run.dir={tmp_path / 'out'}"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    if check:
        assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def told(tmp_path, cache, monkeypatch, capfd):
    """Run the command in this process, which saves the imports: (exit code, standard output, standard error)."""

    def run(*overrides):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
        monkeypatch.delenv("WORKBENCH_DATA", raising=False)
        monkeypatch.setattr(sys, "argv", ["workbench", *overrides, f"hydra.run.dir={tmp_path / 'out'}"])
        try:
            code = main()
        except SystemExit as end:
            code = end.code
        logging.captureWarnings(False)
        return code, *capfd.readouterr()

    return run


@pytest.mark.parametrize("experiment", ["walk_straight", "walk_circle", "walk_prior_only"])
def test_every_experiment_runs_and_leaves_a_recording(tmp_path, cache, experiment):
    done = workbench(tmp_path, f"experiment={experiment}", *SMALL, cache=cache)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "complete"
    assert (summary["experiment"], summary["seed"]) == (experiment, 0)
    needed = {"error_abs_mm", "error_rel_mm", "error_px", "ess_mean", "log_evidence", "coverage_90", "frames"}
    assert needed <= summary["metrics"].keys()
    assert all(np.isfinite(summary["metrics"][name]) for name in needed)
    assert summary["metrics"]["frames"] == 4
    assert "workbench-view" in done.stdout
    recorded = read(tmp_path / "out" / "run.rrd")
    _, poses = recorded.poses
    assert poses.shape == (4, 25)
    assert "n_particles: 60" in recorded.config
    assert not list((tmp_path / "out").glob("*.part"))


def recorded_run(folder):
    recording = read(folder / "out" / "run.rrd")
    return recording.poses[1], recording.metric("ess")[1], recording.metric("log_evidence")[1]


def test_the_same_seed_and_any_number_of_threads_give_the_same_bits(tmp_path, cache):
    results = []
    for name, overrides in (("a", ["threads=1"]), ("b", ["threads=1"]), ("c", ["threads=2"]), ("d", ["seed=1"])):
        folder = tmp_path / name
        folder.mkdir()
        if name == "c" and (os.cpu_count() or 1) < 2:
            pytest.skip("one core only: cannot run with two threads")
        workbench(folder, *SMALL, *overrides, cache=cache)
        results.append(recorded_run(folder))
    for other in results[1:3]:
        assert all((a == b).all() for a, b in zip(results[0], other, strict=True))
    assert not (results[0][0] == results[3][0]).all()


def test_a_recorded_clip_by_override(tmp_path, cache, data):
    workbench(tmp_path, f"paths.data={data}", "dataset.motion=35_02", *SMALL, cache=cache)
    metrics = json.loads((tmp_path / "out" / "summary.json").read_text())["metrics"]
    assert metrics["error_abs_mm"] < 500  # on the person, not lost


@pytest.mark.slow
def test_a_library_of_ones_own_and_the_body_of_a_file(tmp_path, cache, data):
    clips = [str(data / "cmu" / "35" / f"35_{take}.amc") for take in ("01", "02", "07", "08", "09")]
    assert import_motions([*clips, "-o", str(tmp_path / "mine.h5")]) == 0
    prior = ("prior.motions=mine.h5", "prior.n_components=3", "dataset.motion=mine.h5:35_02")
    workbench(tmp_path, *prior, "body=file", f"body.file={clips[1]}", *SMALL, cache=cache)
    metrics = json.loads((tmp_path / "out" / "summary.json").read_text())["metrics"]
    assert metrics["error_abs_mm"] < 200  # three frames after the true start, and the file's body is the right one


@pytest.mark.slow
def test_the_real_video(tmp_path, cache, data):
    overrides = ("dataset.last_frame=72", "inference.n_particles=200")
    workbench(tmp_path, "experiment=walk_video", f"paths.data={data}", *overrides, cache=cache)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "complete"
    assert summary["metrics"]["frames"] == 9
    assert summary["metrics"]["error_px"] < 40  # a person of 390 px, a sixth of a second after the marked start


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["inference.n_particle=3"], "n_particle"),
        (["inference.n_particles=many"], "many"),
        (["inference.n_particles=0"], "n_particles"),
        (["+prior.typo=1"], "typo"),
        (["experiment=walk_nowhere"], "walk_nowhere"),
        (["seed=-1"], "seed"),
        (["threads=0"], "threads"),
        (["dataset.motion=35_02"], "paths.data"),
        (["dataset.motion=no_such.bvh"], "no_such.bvh"),
        (["prior.motions=cmu"], "paths.data"),
        (["prior.motions=everything"], "everything"),
        (["dataset.n_frames=100000"], "100000"),
        (["experiment=walk_video", "paths.data=nowhere"], "nowhere"),
        (["body=height", "body.height_m=180"], "180"),
        (["body=height", "body.height_m=1.8", "body.lengths={thig: 0.4}"], "thig"),
        (["likelihood.exponent=total"], "total"),
    ],
)
def test_wrong_input_is_one_clear_sentence(told, overrides, words):
    code, out, err = told(*overrides)
    assert code == 2, err
    assert words in err
    assert "Traceback" not in out + err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "target", ["os.system", "workbench.cli.run.os.system", "workbench.body.camera.cv2.VideoCapture", "builtins.eval"]
)
def test_foreign_targets_are_refused_before_anything_is_built(told, tmp_path, target):
    code, _, err = told(f"dataset._target_={target}")
    assert code == 2
    assert target in err
    assert "refused" in err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert not list((tmp_path / "out").glob("*.rrd*"))


def test_the_command_itself_tells_bad_input(tmp_path, cache):
    done = workbench(tmp_path, "inference.n_particle=3", cache=cache, check=False)
    assert done.returncode == 2
    assert "n_particle" in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
