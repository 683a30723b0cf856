"""A run resumed from any frame is bitwise identical to the uninterrupted run, with every inference and prior."""

from dataclasses import replace

import numpy as np
import pytest
from hydra import compose, initialize_config_module

from workbench.core.filter_state import ResumePoint
from workbench.core.step import Resumable
from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import assemble
from workbench.priors.fitted_rest import FittedRest, Trajectory
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

N_FRAMES = 4
SCENE = (
    "experiment=custom", "dataset=synthetic", f"dataset.n_frames={N_FRAMES}", "dataset.width=160",
    "dataset.height=120", "dataset.person_px=80.0", "dataset.focal_px=175.0", "paths.data=null",
    "training.motions=builtin",
)  # fmt: skip
CUES = (
    "likelihood=product", "likelihood.weights.edges=0", "likelihood.weights.image_motion=0.5",
    "likelihood.weights.background=0.5", "likelihood.weights.appearance=0.5", "likelihood.weights.silhouette=0.5",
)  # fmt: skip
RESUMABLE = (
    "annealed", "auxiliary", "fixed_lag", "gauss_newton", "particle_filter", "partitioned", "reinitializing",
    "tempered_smc",
)  # fmt: skip
PRIORS = sorted(set(options("prior")) - {"fitted_rest", "fitted_rest_implicit"})  # these need several cameras


@pytest.fixture(scope="module")
def assembled(cache):
    """Return a function that assembles a run's components from overrides of the default scene."""
    prepare_hydra()

    def components(*overrides):
        cues = () if any(text.startswith("likelihood=") for text in overrides) else CUES
        with initialize_config_module("workbench.conf", version_base="1.3"):
            config = compose("config", overrides=[*SCENE, *cues, *overrides, f"paths.cache={cache}"])
        if "n_particles" in config.inference:
            config.inference.n_particles = 40
        return assemble(config)

    return components


def assert_resumed_runs_are_identical(parts):
    run = parts.inference.run
    uninterrupted = list(run(parts.clip, parts.start, rng_streams(0)))
    for k in range(1, N_FRAMES):
        poses = np.stack([step.filter_state.filtered_pose for step in uninterrupted[:k]])
        resumed = list(run(parts.clip, ResumePoint(poses, uninterrupted[k - 1].filter_state), rng_streams(5)))
        assert [step.frame.index for step in resumed] == list(range(k, N_FRAMES))
        for first, second in zip(resumed, uninterrupted[k:], strict=True):
            for name in ("particles", "poses", "log_weights", "ancestors", "expected_pose"):
                np.testing.assert_array_equal(getattr(first, name), getattr(second, name), name)
            numbers = [repr((step.log_evidence, dict(step.diagnostics))) for step in (first, second)]
            assert numbers[0] == numbers[1]
            assert first.warnings == second.warnings


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(options("inference")))
def test_every_resumable_inference_resumes_identically(assembled, name):
    try:
        parts = assembled(f"inference={name}", "prior=ar_offsets")
    except InputError:
        assert name not in RESUMABLE
        return
    resumable = isinstance(parts.inference, Resumable) and parts.inference.resumable
    assert resumable == (name in RESUMABLE)
    if resumable:
        assert_resumed_runs_are_identical(parts)


@pytest.mark.slow
@pytest.mark.parametrize("prior", PRIORS)
def test_a_run_with_any_prior_resumes_identically(assembled, prior):
    assert_resumed_runs_are_identical(
        assembled(f"prior={prior}", "inference=fixed_lag", "inference.min_effective_ancestors=5")
    )


@pytest.mark.slow
def test_a_run_with_fitted_joints_resumes_identically(assembled):
    parts = assembled("prior=smooth", "prior.parameters=[right_arm]", "inference=reinitializing")
    poses = np.linspace(parts.start, parts.start + 0.1, N_FRAMES)
    fitted_rest = FittedRest(parts.prior, lambda: Trajectory(np.arange(N_FRAMES) / 30.0, poses))
    assert_resumed_runs_are_identical(replace(parts, inference=parts.inference.rebuilt(prior=fitted_rest)))
