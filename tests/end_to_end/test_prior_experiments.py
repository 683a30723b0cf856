"""The experiments on priors, from their names, at small size and without recordings."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.motion.library import write_library
from workbench.motion.synthetic.arm import bending_arm
from workbench.motion.synthetic.gait import builtin_motions
from workbench.recording.read.reader import read

SMALL = (
    "dataset.n_frames=4",
    "dataset.width=160",
    "dataset.height=120",
    "dataset.person_px=80",
    "dataset.focal_px=175",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Holds mine.h5, three arms and three walkers, and a cache."""
    folder = tmp_path_factory.mktemp("priors")
    arm = bending_arm(4.0, 30.0)
    arms = [replace(arm, name=f"arm_{k}", poses=arm.poses[7 * k :]) for k in range(3)]
    write_library(folder / "mine.h5", [*arms, *builtin_motions(3)])
    return folder


ARM = ("dataset.motion=mine.h5:arm_1", "dataset.first_frame=8")
EXPERIMENTS = {
    "arm_twist": ("inference.n_particles=100",),
    "walk_cyclic": ("inference.n_particles=100",),
    "arm_smooth_300 prior=implicit": (*ARM, "prior.motions=mine.h5", "inference.n_particles=50"),
    "arm_smooth_300": (*ARM, "inference.n_particles=50"),
    "body_implicit": ("dataset.motion=builtin", "prior.motions=builtin", "inference.n_particles=50"),
    "body_smooth": ("dataset.motion=builtin", "inference.n_particles=50"),
}


ALIKE = ("arm_smooth_300", "body_smooth")
CASES = [pytest.param(name, marks=pytest.mark.slow) if name in ALIKE else name for name in EXPERIMENTS]


@pytest.mark.parametrize("experiment", CASES)
def test_an_experiment_on_priors_runs_from_its_name(folder, summary_of, tmp_path, experiment):
    name, *chosen = experiment.split()
    summary = summary_of(folder, f"experiment={name}", *chosen, *EXPERIMENTS[experiment], *SMALL)
    assert (summary["status"], summary["experiment"]) == ("complete", name)
    metrics = summary["metrics"]
    assert {"held", "forearm_px", "error_px", "error_rel_mm", "error_abs_mm"} <= metrics.keys()
    assert metrics["held"] in (0.0, 1.0)
    # three frames: fewer than five are averaged together
    assert metrics["held"] == float(metrics["error_px"] < metrics["forearm_px"])
    assert read(tmp_path / "out" / "run.rrd").poses[1].shape == (4, 25)


def test_the_clip_tracked_is_left_out_of_the_database(folder, summary_of, tmp_path):
    summary_of(folder, "experiment=arm_smooth_300", "prior=implicit", *ARM, "prior.motions=mine.h5", *SMALL)
    logs = "".join(path.read_text() for path in (tmp_path / "out").glob("*.log"))
    assert "motion database: 5 clips of 6" in logs


@pytest.mark.parametrize(
    "prior",
    [
        ("prior=flipping", "learn.motions=builtin"),
        ("prior=implicit", "prior.motions=builtin", "prior.search=sign_tree", "prior.reweight=true"),
    ],
)
def test_priors_without_an_experiment_of_their_own_track_too(folder, summary_of, prior):
    summary = summary_of(folder, "experiment=custom", *prior, "inference.n_particles=40", *SMALL)
    assert summary["status"] == "complete"
    assert np.isfinite(summary["metrics"]["error_px"])
