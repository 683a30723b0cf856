"""`workbench diagnose` on a run that loses the track for a known reason."""

import pytest

from workbench.cli.main import main
from workbench.recording.read.reader import read

SMALL = ("dataset.n_frames=20", "dataset.width=160", "dataset.height=120", "dataset.person_px=80")
SMALL += ("dataset.focal_px=175", "inference.n_particles=40", "training.motions=builtin")


@pytest.mark.slow
def test_the_cause_of_a_track_loss_ranks_first(tmp_path, run, capfd):
    code, output, folder = run("lost", "experiment=walk_circle", *SMALL, "body.scale=1.4")
    assert code == 0, output
    path = str(folder / "run.rrd")
    assert main(["diagnose", path, "--frame", "18", "--seeds", "1", "--jobs", "2", "-o", str(tmp_path / "runs")]) == 0
    out = capfd.readouterr().out
    assert "most likely: the true body, with which 1 of 1 runs keep the track" in out
    folder = tmp_path / "runs" / "frame_18"
    assert int(read(folder / "only_another_seed" / "1000" / "run.rrd").poses[0][0]) == 0
    assert main(["diagnose", path, "--frame", "99"]) == 2
    assert "--frame: expected a recorded frame, found 99" in capfd.readouterr().err


@pytest.mark.slow
def test_a_run_without_track_loss_needs_no_diagnosis(run, capfd):
    code, output, folder = run("tracked", "experiment=walk_circle", *SMALL)
    assert code == 0, output
    assert main(["diagnose", str(folder / "run.rrd")]) == 0
    assert "no track loss" in capfd.readouterr().out
    assert main(["diagnose", str(folder / "nothing.rrd")]) == 2
    assert "no such recording" in capfd.readouterr().err
