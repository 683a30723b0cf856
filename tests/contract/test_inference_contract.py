"""What every inference keeps, on rendered people: whole steps, costs, seeds, threads."""

import numba
import numpy as np
import pytest
from hydra import compose, initialize_config_module

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
USUAL = {
    "least_squares": ("experiment=points_walk_variable", *POINTS),
    "hybrid": ("experiment=points_hybrid", *POINTS),
    "synthesis": ("experiment=custom", "dataset=blank", "dataset.n_frames=6"),
    "iterated_ekf": (
        "experiment=custom",
        *SCENE[:-2],
        "prior=linear",
        "training.motions=builtin",
        "likelihood=dense_alignment",
    ),
}
"""What the inferences run on that do not track images, or not with any prior."""
SOLVING = ("least_squares", "synthesis")
"""Whose particles are no weighted draws of a prior that they decode to poses."""


@pytest.fixture(scope="module")
def parts(cache):
    prepare_hydra()
    made = {}
    with initialize_config_module("workbench.conf", version_base="1.3"):
        for name in NAMES:
            usual = [*USUAL.get(name, ("experiment=custom", *SCENE)), f"inference={name}", "paths.data=null"]
            config = compose("config", overrides=[*usual, f"paths.cache={cache}"])
            for key in ("n_particles", "n_paths"):
                if key in config.inference:
                    config.inference[key] = N
            made[name] = assemble(config)
    return made


def steps(parts, name, seed=0):
    own = parts[name]
    return list(own.inference.run(own.clip, own.start, rng_streams(seed)))


@pytest.mark.parametrize("name", NAMES)
def test_a_step_for_every_frame_is_whole(parts, name):
    own, found = parts[name], steps(parts, name)
    assert [step.frame.index for step in found] == [frame.index for frame in own.clip]
    assert isinstance(own.inference.finds_start, bool)
    for step in found:
        n = 1 if name == "synthesis" else N
        assert step.particles.shape == (n, len(own.inference.space))
        assert step.space.names == own.inference.space.names
        weights = np.exp(step.log_weights)
        assert weights.sum() == pytest.approx(1.0)
        if name not in SOLVING:
            np.testing.assert_allclose(step.expected_pose, weights @ step.poses, atol=1e-12)
            np.testing.assert_array_equal(step.poses, own.prior.pose(step.particles))
            assert (step.poses == step.map_pose).all(axis=1).any()
        assert 1.0 <= step.ess <= n + 1e-6
        assert ((step.ancestors >= 0) & (step.ancestors < n)).all()
        assert all(np.isfinite(value) for value in step.diagnostics.values())
        # a recording arranges its views by the first step's
        assert set(step.diagnostics) <= set(found[0].diagnostics) or name == "synthesis"
    assert np.isnan(found[-1].log_evidence) == (name in (*SOLVING, "annealed"))  # which estimate none
    if name not in SOLVING:
        assert all(step.evaluations >= N for step in found[1:])
        assert sum(step.timing_s["likelihood"] for step in found[1:]) > 0.0


@pytest.mark.slow
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
