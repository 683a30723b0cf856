"""What every inference that tracks by particles keeps, on rendered images: whole steps, costs, seeds, threads."""

from importlib.resources import files

import numba
import numpy as np
import pytest
from hydra import compose, initialize_config_module

from workbench.cli.build import build
from workbench.cli.execute import rng_streams
from workbench.cli.run import prepare_hydra
from workbench.datasets.synthetic import Synthetic

YAMLS = {path.name.removesuffix(".yaml") for path in files("workbench.conf").joinpath("inference").iterdir()}
NO_PARTICLE_FILTERS = {"synthesis", "least_squares", "hybrid"}
NAMES = sorted(name for name in YAMLS - NO_PARTICLE_FILTERS if not name.startswith("_"))
N = 40


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    prepare_hydra()
    cache = str(tmp_path_factory.mktemp("cache"))
    dataset = Synthetic(n_frames=4, width=160, height=120, person_px=80.0, focal_px=175.0)
    with initialize_config_module("workbench.conf", version_base="1.3"):
        overrides = ["experiment=custom", f"paths.cache={cache}", "prior=jitter", "prior.base.n_components=3"]
        some = compose("config", overrides=overrides)
        configs = {name: compose(f"inference/{name}") for name in NAMES}  # that part alone takes far less time
    body = build(some.body, dataset_shape=dataset.shape, full_body=None)
    return configs, dataset, build(some.prior), build(some.likelihood, body=body)


def steps(parts, name, seed=0):
    configs, dataset, prior, likelihood = parts
    config = configs[name].inference
    config.n_particles = N
    if "n_paths" in config:
        config.n_paths = N
    inference = build(config, prior=prior, likelihood=likelihood)
    assert inference.space == prior.space
    return list(inference.run(dataset.frames(), dataset.start_pose, rng_streams(seed)))


def test_the_filters_are_all_here():
    assert {"particle_filter", "tempered_smc", "annealed", "backward_simulation"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_step_for_every_frame_is_whole(parts, name):
    _, dataset, prior, _ = parts
    found = steps(parts, name)
    assert [step.frame.index for step in found] == list(range(len(dataset)))
    assert found[0].evaluations == 0.0
    for step in found:
        assert step.particles.shape == (N, len(prior.space))
        weights = np.exp(step.log_weights)
        assert weights.sum() == pytest.approx(1.0)
        np.testing.assert_allclose(step.expected_pose, weights @ step.poses, atol=1e-12)
        np.testing.assert_array_equal(step.poses, prior.pose(step.particles))
        assert (step.poses == step.map_pose).all(axis=1).any()
        assert 1.0 <= step.ess <= N + 1e-6
        assert ((step.ancestors >= 0) & (step.ancestors < N)).all()
        assert np.isfinite(step.log_evidence)
        assert all(np.isfinite(value) for value in step.diagnostics.values())
        # a recording arranges its views by the first step's
        assert set(step.diagnostics) <= set(found[0].diagnostics)
    assert all(step.evaluations >= N for step in found[1:])
    assert sum(step.timing_s["likelihood"] for step in found[1:]) > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_bits_with_any_number_of_threads(parts, name):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core only: cannot run with two threads")
    found = []
    for threads, seed in ((1, 0), (2, 0), (2, 1)):
        numba.set_num_threads(threads)
        found.append(steps(parts, name, seed)[-1])
    assert (found[0].particles == found[1].particles).all()
    assert (found[0].log_weights == found[1].log_weights).all()
    assert not (found[0].particles == found[2].particles).all()
