"""What continues goes on from any frame with the same bits: every inference, every prior, and cues that remember."""

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
    "likelihood.terms.silhouette.background_from_first_pose=true",
)  # fmt: skip
CONTINUE = (
    "annealed", "auxiliary", "fixed_lag", "gauss_newton", "particle_filter", "partitioned", "reinitializing",
    "tempered_smc",
)  # fmt: skip
PRIORS = sorted(set(options("prior")) - {"fitted_rest", "fitted_rest_implicit"})  # which need joints of several cameras


@pytest.fixture(scope="module")
def made(cache):
    """Parts by the options that differ from the usual; InputError for those that do not go together."""
    prepare_hydra()

    def parts(*overrides):
        cues = () if any(text.startswith("likelihood=") for text in overrides) else CUES
        with initialize_config_module("workbench.conf", version_base="1.3"):
            config = compose("config", overrides=[*SCENE, *cues, *overrides, f"paths.cache={cache}"])
        if "n_particles" in config.inference:
            config.inference.n_particles = 40
        return assemble(config)

    return parts


def assert_it_goes_on_with_the_same_bits(parts):
    run = parts.inference.run
    whole = list(run(parts.clip, parts.start, rng_streams(0)))
    for k in range(1, N_FRAMES):
        expected = np.stack([step.filter_state.filtered_pose for step in whole[:k]])
        found = list(run(parts.clip, ResumePoint(expected, whole[k - 1].filter_state), rng_streams(5)))
        assert [step.frame.index for step in found] == list(range(k, N_FRAMES))
        for one, other in zip(found, whole[k:], strict=True):
            for name in ("particles", "poses", "log_weights", "ancestors", "expected_pose"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
            assert repr((one.log_evidence, dict(one.diagnostics))) == repr(
                (other.log_evidence, dict(other.diagnostics))
            )
            assert one.warnings == other.warnings


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(options("inference")))
def test_every_inference_goes_on_or_says_that_it_cannot(made, name):
    usual = (
        ("prior=linear", "training.motions=builtin", "likelihood=dense_alignment")
        if name == "iterated_ekf"
        else ("prior=ar_offsets",)
    )
    try:
        parts = made(f"inference={name}", *usual)
    except InputError:
        assert name not in CONTINUE
        return
    resumable = isinstance(parts.inference, Resumable) and parts.inference.resumable
    assert resumable == (name in CONTINUE)
    if resumable:
        assert_it_goes_on_with_the_same_bits(parts)


@pytest.mark.slow
@pytest.mark.parametrize("prior", PRIORS)
def test_it_goes_on_with_every_prior(made, prior):
    assert_it_goes_on_with_the_same_bits(
        made(f"prior={prior}", "inference=fixed_lag", "inference.min_effective_ancestors=5")
    )


@pytest.mark.slow
def test_it_goes_on_where_the_rest_of_the_body_follows_a_trajectory(made):
    parts = made("prior=smooth", "prior.parameters=[right_arm]", "inference=reinitializing")
    poses = np.linspace(parts.start, parts.start + 0.1, N_FRAMES)
    fitted_rest = FittedRest(parts.prior, lambda: Trajectory(np.arange(N_FRAMES) / 30.0, poses))
    assert_it_goes_on_with_the_same_bits(replace(parts, inference=parts.inference.rebuilt(prior=fitted_rest)))
