"""Real runs reported: what they cost, and that the report's numbers are theirs."""

import re

import numpy as np
import pytest

from workbench.cli.main import main
from workbench.recording.read.reader import read
from workbench.results.formatting import number
from workbench.results.report.plots import joint_errors

SMALL = ("experiment=custom", "dataset.n_frames=4", "dataset.width=160", "dataset.height=120")


def test_runs_of_two_priors_become_a_report(run, tmp_path, capfd):
    for prior in ("walking", "smooth"):
        code, told, _ = run(f"sweep/{prior}", *SMALL, f"prior={prior}", "inference.n_particles=30")
        assert code == 0, told
    assert main(["report", str(tmp_path / "sweep")]) == 0
    told = capfd.readouterr().out
    assert "2 groups by prior, repeated over seeds." in told
    for prior in ("walking", "smooth"):
        recorded = read(tmp_path / "sweep" / prior / "run.rrd")
        cost, error = recorded.properties["cost"], recorded.result["error_abs_mm"]
        assert cost["likelihood_evaluations"] == 30 * 3  # the first frame is given
        assert cost["seconds"] == pytest.approx(4e-3 * cost["ms_per_frame"])
        assert not cost.keys() & recorded.result.keys()  # or equal runs would not give equal metrics
        assert re.search(rf"\n{prior} +1 +1 +{number(error)} +– +– +– +–\n", told)
        joints = dict(joint_errors(recorded))
        del joints["pelvis"]  # not one of those whose mean is a run's error
        # positions are kept to float32, in metres
        assert np.mean(list(joints.values())) == pytest.approx(error, abs=1e-3)


@pytest.mark.slow
def test_a_fit_costs_its_iterations_and_has_no_plot_against_particles(run, tmp_path):
    small = ("dataset.n_frames=8", "dataset.n_points=60", "prior.n_components=3", "inference.n_particles=30")
    for seed in (0, 1):
        code, told, folder = run(f"sweep/{seed}", "experiment=points_walk_steady", f"seed={seed}", *small)
        assert code == 0, told
        recorded = read(folder / "run.rrd")
        cost, iterations = recorded.properties["cost"], recorded.result["iterations"]
        assert cost["likelihood_evaluations"] == pytest.approx(8 * iterations)
    assert main(["report", str(tmp_path / "sweep"), "-o", str(tmp_path / "out")]) == 0
    assert not (tmp_path / "out" / "error_against_particles.png").exists()
    assert (tmp_path / "out" / "coverage.png").exists()
