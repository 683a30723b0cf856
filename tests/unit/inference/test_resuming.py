"""A particle filter resumed after any frame repeats the run bit for bit, for every algorithm and wrapper."""

from dataclasses import replace

import numpy as np
import pytest
from linear_gaussian import MEAN0, Memoryless, MemorylessFrameLikelihood, Position, TwoJoints, frames, simulate, streams

from workbench.core.filter_state import ResumePoint
from workbench.core.step import Resumable
from workbench.inference.smc.bootstrap import Auxiliary, Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ANCESTRY_FRAMES, ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.reinitializing import REFERENCE_FRAMES, Reinitializing
from workbench.inference.smc.smoothing import FixedLag
from workbench.inference.smc.tempered_smc import Annealed, TemperedSMC
from workbench.utils.errors import InputError

T, N = ANCESTRY_FRAMES + 4, 40
ALGORITHMS = {
    "bootstrap": Bootstrap(ess_threshold=0.5),
    "auxiliary": Auxiliary(),
    "partitioned": Partitioned(partitions=["lower_body", "upper_body"]),
    "gauss_newton": GaussNewton(),
    "tempered_smc": TemperedSMC(),
    "annealed": Annealed(),
}
WRAPPERS = {
    "filter": lambda filter_: filter_,
    "reinitializing": Reinitializing,
    "fixed_lag": lambda filter_: FixedLag(filter_, lag=3, min_effective_ancestors=10),
    "fixed_lag of reinitializing": lambda filter_: FixedLag(Reinitializing(filter_), lag=2, min_effective_ancestors=1),
}


class Drifting(Memoryless):
    """A likelihood of measurements with an offset, a running mean of the poses it was updated with."""

    def __init__(self, measured, offset=0.0):
        self.measured, self.offset = measured, offset

    def log_prob(self, previous, frame, previous_pose, pose):
        return Position(self.measured - self.offset).log_prob(previous, frame, previous_pose, pose)

    def prepare(self, previous, frame):
        frame_likelihood = MemorylessFrameLikelihood(self, previous, frame)
        frame_likelihood.update = lambda expected: Drifting(self.measured, 0.9 * self.offset + 0.1 * expected[0])
        return frame_likelihood


def inference(wrapper, algorithm, measured=None):
    likelihood = Drifting(simulate(T, seed=3) if measured is None else measured)
    return WRAPPERS[wrapper](ParticleFilter(TwoJoints(), likelihood, algorithm=ALGORITHMS[algorithm], n_particles=N))


def resume_point(steps):
    """Return the point after these first steps of a run."""
    return ResumePoint(np.stack([step.filter_state.filtered_pose for step in steps]), steps[-1].filter_state)


def assert_resumes(tracker, steps, point):
    """Assert that a run resumed at a point repeats the remaining steps; its generators are restored from the point."""
    first = len(point.filtered_poses)
    resumed = list(tracker.run(frames(len(steps)), point, streams(7)))
    assert [step.frame.index for step in resumed] == list(range(first, len(steps)))
    for step, expected in zip(resumed, steps[first:], strict=True):
        for name in ("particles", "poses", "log_weights", "ancestors", "expected_pose", "map_pose"):
            np.testing.assert_array_equal(getattr(step, name), getattr(expected, name))
        assert repr((step.ess, step.log_evidence)) == repr((expected.ess, expected.log_evidence))
        assert (step.diagnostics, step.warnings) == (expected.diagnostics, expected.warnings)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.slow
def test_a_resumed_run_is_bitwise_identical(wrapper, algorithm):
    tracker = inference(wrapper, algorithm)
    assert isinstance(tracker, Resumable)
    assert tracker.resumable
    steps = list(tracker.run(frames(T), MEAN0, streams(0)))
    for k in (1, 2, T // 2, T - 2, T - 1, T):
        assert_resumes(tracker, steps, resume_point(steps[:k]))


@pytest.mark.parametrize("wrapper", ["filter", "fixed_lag"])
def test_a_resumed_run_depends_on_parents_only(wrapper):
    tracker = inference(wrapper, "bootstrap")
    steps = list(tracker.run(frames(T), MEAN0, streams(0)))
    k = next(t for t in range(1, T) if len(np.unique(steps[t].filter_state.parents)) < N)  # the first resampled frame
    parents, point = steps[k].filter_state.parents, resume_point(steps[:k])
    state = np.full_like(point.filter_state.arrays["state"], 1e9)
    state[parents] = point.filter_state.arrays["state"][parents]
    point = replace(point, filter_state=point.filter_state.with_arrays(state=state, poses=state))
    assert_resumes(tracker, steps, point)


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS.keys() - {"bootstrap"}))
def test_other_algorithms_depend_on_every_particle(algorithm):
    step = next(iter(inference("filter", algorithm).run(frames(2), MEAN0, streams(0))))
    assert step.filter_state.parents is None


def test_a_resumed_run_detects_the_same_track_loss():
    measured = simulate(REFERENCE_FRAMES + 12, seed=3)
    measured[REFERENCE_FRAMES + 4 :] += 50.0  # the track is lost from here
    tracker = inference("reinitializing", "bootstrap", measured)
    steps = list(tracker.run(frames(len(measured)), MEAN0, streams(0)))
    first = next(step.frame.index for step in steps if step.diagnostics["reinitialized"])
    for k in (1, first - 1, first, first + 1):
        assert_resumes(tracker, steps, resume_point(steps[:k]))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"state": None}, "an array state"),
        ({"state": np.zeros((N, 3))}, "shape"),
        ({"log_weights": np.zeros((N, 1))}, "log_weights with 1 axes"),
    ],
)
def test_a_checkpoint_with_other_arrays_is_rejected(arrays, message):
    (step,) = inference("filter", "bootstrap").run(frames(1), MEAN0, streams(0))
    state = step.filter_state
    damaged = {name: value for name, value in {**state.arrays, **arrays}.items() if value is not None}
    point = ResumePoint(state.filtered_pose[None], replace(state, arrays=damaged))
    with pytest.raises(InputError, match=message):
        list(inference("filter", "bootstrap").run(frames(2), point, streams(0)))


@pytest.mark.parametrize("state", [{}, {"bit_generator": "PCG64", "state": 3}, {"bit_generator": "MT19937"}])
def test_an_invalid_generator_state_is_rejected(state):
    (step,) = inference("filter", "bootstrap").run(frames(1), MEAN0, streams(0))
    point = resume_point([replace(step, filter_state=replace(step.filter_state, rng_states={"prior": state}))])
    with pytest.raises(InputError, match="random stream prior"):
        list(inference("filter", "bootstrap").run(frames(2), point, streams(0)))
