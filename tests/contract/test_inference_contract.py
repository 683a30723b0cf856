"""The contract of every inference on rendered people: complete steps, costs, seeds and threads."""

import numba
import numpy as np
import pytest
from hydra import compose, initialize_config_module

from workbench.evaluation.metrics import row_of
from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import assemble
from workbench.utils.rng import rng_streams

NAMES = sorted(options("inference"))
N = 40
SCENE = (
    "dataset.n_frames=4", "dataset.width=160", "dataset.height=120", "dataset.person_px=80.0",
    "dataset.focal_px=175.0", "prior=ar_offsets", "prior.base.n_components=3",
)  # fmt: skip
POINTS = ("dataset.n_frames=6", "dataset.n_points=80", "prior.n_components=3")
SETTINGS = {
    "least_squares": ("experiment=points_walk_variable", *POINTS),
    "hybrid": ("experiment=points_hybrid", *POINTS),
    "synthesis": ("experiment=custom", "dataset=blank", "dataset.n_frames=6"),
}
"""Settings of inferences that do not track images or that need a particular prior."""
WITHOUT_WEIGHTED_SAMPLES = ("least_squares", "synthesis")
"""Inferences whose particles are not weighted samples of a prior."""


@pytest.fixture(scope="module")
def parts(cache):
    prepare_hydra()
    assembled = {}
    with initialize_config_module("workbench.conf", version_base="1.3"):
        for name in NAMES:
            overrides = [*SETTINGS.get(name, ("experiment=custom", *SCENE)), f"inference={name}", "paths.data=null"]
            config = compose("config", overrides=[*overrides, f"paths.cache={cache}"])
            for key in ("n_particles", "n_paths"):
                if key in config.inference:
                    config.inference[key] = N
            assembled[name] = assemble(config)
    return assembled


def steps(parts, name, seed=0):
    run = parts[name]
    return list(run.inference.run(run.clip, run.start, rng_streams(seed)))


@pytest.mark.parametrize("name", NAMES)
def test_every_frame_has_a_complete_step(parts, name):
    run, run_steps = parts[name], steps(parts, name)
    assert [step.frame.index for step in run_steps] == [frame.index for frame in run.clip]
    assert isinstance(run.inference.finds_start, bool)
    for step in run_steps:
        n = 1 if name == "synthesis" else N
        assert step.particles.shape == (n, len(run.inference.space))
        assert step.space.names == run.inference.space.names
        weights = np.exp(step.log_weights)
        assert weights.sum() == pytest.approx(1.0)
        if name not in WITHOUT_WEIGHTED_SAMPLES:
            np.testing.assert_allclose(step.expected_pose, weights @ step.poses, atol=1e-12)
            np.testing.assert_array_equal(step.poses, run.prior.pose(step.particles))
            assert (step.poses == step.map_pose).all(axis=1).any()
        assert 1.0 <= step.ess <= n + 1e-6
        assert ((step.ancestors >= 0) & (step.ancestors < n)).all()
        assert all(np.isfinite(value) for value in step.diagnostics.values())
        assert {name for name in step.diagnostics if not row_of(name).meaning} == set()  # of the table of metrics
        # a recording arranges its views by the diagnostics of the first step
        assert set(step.diagnostics) <= set(run_steps[0].diagnostics) or name == "synthesis"
    assert np.isnan(run_steps[-1].log_evidence) == (name in (*WITHOUT_WEIGHTED_SAMPLES, "annealed"))  # no evidence
    if name not in WITHOUT_WEIGHTED_SAMPLES:
        assert all(step.evaluations >= N for step in run_steps[1:])
        assert sum(step.timing_s["likelihood"] for step in run_steps[1:]) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_seed_gives_bitwise_identical_steps_at_any_number_of_threads(parts, name):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core only: cannot run with two threads")
    last = []
    for threads, seed in ((1, 0), (2, 0), (2, 1)):
        numba.set_num_threads(threads)
        last.append(steps(parts, name, seed)[-1])
    assert (last[0].particles == last[1].particles).all()
    assert (last[0].log_weights == last[1].log_weights).all()
    assert not (last[0].particles == last[2].particles).all()
