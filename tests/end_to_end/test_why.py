"""workbench-why on a run that lost the person for a reason that is known."""

import pytest

from workbench.cli.diagnose import main
from workbench.recording.read.chunks import curves, read_chunks

SMALL = ("dataset.n_frames=20", "dataset.width=160", "dataset.height=120", "dataset.person_px=80")
SMALL += ("dataset.focal_px=175", "inference.n_particles=40", "learn.motions=builtin")


@pytest.mark.slow
def test_the_cause_of_a_loss_is_told_and_all_futures_are_in_one_recording(tmp_path, run, capfd):
    code, told, folder = run("lost", "experiment=walk_circle", *SMALL, "body.scale=1.4")
    assert code == 0, told
    assert main([str(folder / "run.rrd"), "--seeds", "2", "--jobs", "2"]) == 0
    out = capfd.readouterr().out
    assert "most likely: the person's own lengths, which holds in 2 of 2" in out
    rows = [line for line in out.splitlines() if " of 2 " in line]
    (path,) = (folder / ".why").iterdir()
    assert f"rerun {path}" in out
    found = read_chunks(path, ["/futures/**"])
    assert len(curves(found)) == 2 * (len(rows) - 1)  # two seeds of every change; the sentence is no row
    assert any(chunk.entity_path.endswith("image/futures/0") for chunk in read_chunks(path, ["/world/**"]))


@pytest.mark.slow
def test_who_was_never_lost_needs_no_reason(run, capfd):
    code, told, folder = run("held", "experiment=walk_circle", *SMALL)
    assert code == 0, told
    assert main([str(folder / "run.rrd")]) == 0
    assert "never lost" in capfd.readouterr().out
    assert main([str(folder / "nothing.rrd")]) == 2
    assert "no such recording" in capfd.readouterr().err
