"""A filter that goes on from the memory of a frame: bit by bit what it would have been, with every move and wrapper."""

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
MOVES = {
    "bootstrap": Bootstrap(ess_threshold=0.5),
    "auxiliary": Auxiliary(),
    "partitioned": Partitioned(partitions=["lower_body", "upper_body"]),
    "gauss_newton": GaussNewton(),
    "tempered_smc": TemperedSMC(),
    "annealed": Annealed(),
}
WRAPPERS = {
    "filter": lambda plain: plain,
    "reinitializing": lambda plain: Reinitializing(plain),
    "fixed_lag": lambda plain: FixedLag(plain, lag=3, min_effective_ancestors=10),
    "fixed_lag of reinitializing": lambda plain: FixedLag(Reinitializing(plain), lag=2, min_effective_ancestors=1),
}


class Drifting(Memoryless):
    """Measurements that are off by what the likelihood has learned of the poses expected so far."""

    def __init__(self, measured, learned=0.0):
        self.measured, self.learned = measured, learned

    def log_prob(self, previous, frame, previous_pose, pose):
        return Position(self.measured - self.learned).log_prob(previous, frame, previous_pose, pose)

    def prepare(self, previous, frame):
        frame_likelihood = MemorylessFrameLikelihood(self, previous, frame)
        frame_likelihood.remember = lambda expected: Drifting(self.measured, 0.9 * self.learned + 0.1 * expected[0])
        return frame_likelihood


def inference(wrapper, move, n=N, measured=None):
    measured = simulate(T, seed=3) if measured is None else measured
    return WRAPPERS[wrapper](ParticleFilter(TwoJoints(), Drifting(measured), algorithm=MOVES[move], n_particles=n))


def past(steps):
    """What a run goes on from after these steps."""
    return ResumePoint(np.stack([step.filter_state.filtered_pose for step in steps]), steps[-1].filter_state)


def assert_same_bits(found, expected):
    assert [step.frame.index for step in found] == [step.frame.index for step in expected]
    for one, other in zip(found, expected, strict=True):
        for name in ("particles", "poses", "log_weights", "ancestors", "expected_pose", "map_pose"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert repr((one.ess, one.log_evidence)) == repr((other.ess, other.log_evidence))
        assert (one.diagnostics, one.warnings) == (other.diagnostics, other.warnings)


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.slow
def test_from_any_frame_on_the_bits_are_the_runs(wrapper, move):
    one = inference(wrapper, move)
    assert isinstance(one, Resumable)
    assert one.resumable
    whole = list(one.run(frames(T), MEAN0, streams(0)))
    for k in (1, 2, T // 2, T - 2, T - 1, T):
        found = list(one.run(frames(T), past(whole[:k]), streams(7)))  # whose streams are set to where the run's were
        assert_same_bits(found, whole[k:])


@pytest.mark.parametrize("wrapper", ["filter", "fixed_lag"])
@pytest.mark.parametrize("move", MOVES)
def test_states_without_offspring_do_not_matter_where_a_memory_says_so(wrapper, move):
    one = inference(wrapper, move)
    whole = list(one.run(frames(T), MEAN0, streams(0)))
    gathered = whole[4].filter_state.parents
    assert (gathered is None) == (move != "bootstrap")
    if gathered is not None:
        before = past(whole[:4])
        state = np.full_like(before.filter_state.arrays["state"], 1e9)
        state[gathered] = before.filter_state.arrays["state"][gathered]
        thinned = replace(before, filter_state=before.filter_state.with_arrays(state=state, poses=state))
        assert_same_bits(list(one.run(frames(T), thinned, streams(7))), whole[4:])


def test_what_restarting_has_seen_goes_on_too():
    measured = simulate(REFERENCE_FRAMES + 12, seed=3)
    measured[REFERENCE_FRAMES + 4 :] += 50.0  # lost from here on
    one = inference("reinitializing", "bootstrap", measured=measured)
    whole = list(one.run(frames(len(measured)), MEAN0, streams(0)))
    anew = [step.frame.index for step in whole if step.diagnostics["reinitialized"]]
    assert anew
    for k in (1, anew[0] - 1, anew[0], anew[0] + 1):
        assert_same_bits(list(one.run(frames(len(measured)), past(whole[:k]), streams(7))), whole[k:])


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"state": None}, "an array state"),
        ({"state": np.zeros((N, 3))}, "shape"),
        ({"log_weights": np.zeros((N, 1))}, "log_weights with 1 axes"),
    ],
)
def test_a_memory_that_is_none_of_a_filter_is_refused(arrays, words):
    whole = list(inference("filter", "bootstrap").run(frames(2), MEAN0, streams(0)))
    filter_state = whole[0].filter_state
    kept = {name: value for name, value in {**filter_state.arrays, **arrays}.items() if value is not None}
    damaged = ResumePoint(filter_state.filtered_pose[None], replace(filter_state, arrays=kept))
    with pytest.raises(InputError, match=words):
        list(inference("filter", "bootstrap").run(frames(2), damaged, streams(0)))


@pytest.mark.parametrize("state", [{}, {"bit_generator": "PCG64", "state": 3}, {"bit_generator": "MT19937"}])
def test_streams_that_cannot_be_set_are_refused(state):
    whole = list(inference("filter", "bootstrap").run(frames(2), MEAN0, streams(0)))
    damaged = past([replace(whole[0], filter_state=replace(whole[0].filter_state, rng_states={"prior": state}))])
    with pytest.raises(InputError, match="random stream prior"):
        list(inference("filter", "bootstrap").run(frames(2), damaged, streams(0)))
