"""Optuna's sweeper tunes a parameter."""

import pytest
import yaml

from workbench.utils.run_files import read_summary

SMALL = (
    "dataset.n_frames=10", "dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175",
    "paths.data=null",
)  # fmt: skip


@pytest.mark.slow
def test_the_tuner_improves_a_bad_process_noise(tmp_path, run):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    common = ("experiment=walk_straight", *SMALL, "inference.n_particles=100", "sweep.objective=mpjpe_abs_mm")
    bad = 0.1  # cycles a frame; the default is 0.009
    code, _, folder = run("bad", *common, f"prior.sigma_phase={bad}")
    assert code == 0
    tuner = ("hydra/sweeper=optuna", "hydra.sweeper.n_trials=6", "hydra.sweeper.sampler.seed=0")
    interval = f"prior.sigma_phase=tag(log,interval(0.0001,{bad}))"
    code, output, _ = run("alone", "-m", *tuner, *common, interval, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert code == 0, output
    best = yaml.safe_load((tmp_path / "sweep" / "optimization_results.yaml").read_text())
    jobs = [read_summary(path.parent) for path in (tmp_path / "sweep").rglob("summary.json")]
    assert len(jobs) == 6
    errors = [job["metrics"]["mpjpe_abs_mm"] for job in jobs]
    assert best["best_value"] == min(errors) < read_summary(folder)["metrics"]["mpjpe_abs_mm"]
