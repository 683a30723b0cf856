"""The experiment on held-out subjects, without an activity model, and its protocol, at small size."""

import json

import pytest

from workbench.cli.main import main

SMALL = (
    "dataset.n_frames=6", "dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175",
    "inference.n_particles=50",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*px tall instead of")
def test_a_held_out_subject_behind_an_occluder_is_tracked_with_expected_errors(run):
    code, output, folder = run(  # the occluder passes within the 30 frames
        "out", "experiment=held_out_subjects", "dataset.motion=builtin", "dataset.occluder=true", "dataset.n_frames=30"
    )
    assert code == 0, output
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    assert metrics["tracked"] == 1.0
    for group in ("root", "head", "arms", "legs"):
        assert metrics[f"expected_error_{group}_mm"] > 0.0
        assert metrics[f"mpjpe_abs_{group}_mm"] > 0.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*px tall instead of")
def test_a_sweep_is_reported_by_split(run, data, tmp_path, capfd):
    code, output, _ = run(
        "sweep", "-m", "experiment=held_out_subjects", "dataset.motion='38_02','02_01'", "dataset.perturb=false",
        "seed=0", "training.motions=builtin", f"paths.data={data}", f"hydra.sweep.dir={tmp_path / 'jobs'}", *SMALL,
    )  # fmt: skip
    assert code == 0, output
    assert main(["report", str(tmp_path / "jobs")]) == 0
    report = capfd.readouterr().out
    assert "split=validation" in report
    assert "split=test" in report
    assert "Spearman" in report
