"""Mixtures of priors: some particles move by one prior, some by another (paper C, section 7; paper A, section 8).

`Mixture` is over one state that all its priors share, `Switching` over priors with states of their own.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy

from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DENSITY, Traits, needs_of_all, offers_of_all
from workbench.core.keys import keeps_keys
from workbench.core.prior import Density, Powers, Prior, Smoothness, propose
from workbench.core.state_space import StateSpace
from workbench.priors.density import REFERENCE_RATE_HZ
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError


@keeps_keys
class Mixture:
    """K priors over one common state, each of which moves its share of the particles.

        p(s_t | s_t−1) = Σ_k π_k p_k(s_t | s_t−1)

    A state is the common one and, in a last column "component", the index k of the prior that drew it; the next draw
    does not depend on it. `step` chooses k by π for every particle and then draws s_t from p_k: an exact draw from
    the mixture, which needs no correction. The k are stratified (`stratified_choice`), so that each prior moves as many
    particles as its weight says, to within one.

    `propose` chooses k by other probabilities, the shares κ, for instance to let many particles try an improbable
    prior. Then a particle stands for the mixture only with the additional weight π_k / κ_k, which `propose` returns
    (importance sampling of the pairs (k, s_t); the mixture is their marginal).

    priors, weights: by name; the weights π sum to one. All priors have the same columns with the same meaning; the
    first one decodes them to poses. shares: κ by name; None means π. Only `propose` uses them.
    Raises InputError when columns differ, when weights or shares are no probabilities, and when a prior with a weight
    has no share, for which no correction could make up.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density where all priors have one."""
        priors = keys["priors"]
        return Traits(offers_of_all(priors) & {DENSITY}, needs_of_all(priors))

    def __init__(
        self, priors: Mapping[str, Prior], weights: Mapping[str, float], *, shares: Mapping[str, float] | None = None
    ) -> None:
        self.priors = dict(priors)
        self.weights = _probabilities("weights", priors, weights)
        self.shares = self.weights if shares is None else _probabilities("shares", priors, shares)
        if lacking := np.array(list(priors))[(self.weights > 0.0) & (self.shares == 0.0)].tolist():
            raise InputError(f"prior: the mixture's {lacking[0]!r} has a weight, but no share of the particles")
        first, *others = priors.items()
        for name, prior in others:
            if (prior.space.names, prior.space.units) != (first[1].space.names, first[1].space.units):
                raise InputError(f"prior: the mixture's {name!r} and {first[0]!r} must have the same columns")
        self.space = first[1].space.appended("component", ("component",), ("",))
        self.parameters = _union(priors)

    @property
    def powers(self) -> Powers:
        """The mixture of the priors' densities, where all have one over the same columns; what they have in common."""
        found = [prior.powers.density for prior in self.priors.values()]
        densities = [density for density in found if density is not None]
        same = len(densities) == len(found) and all(np.array_equal(d.free, densities[0].free) for d in densities)
        density = MixtureDensity(densities, self.weights) if same else None
        return Powers(density, smoothness=common_smoothness(self.priors), examples=all_examples(self.priors))

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), each prior's part of them by its own start."""
        component = stratified_choice(self.weights, n, rng)
        state = np.empty((n, len(self.space)))
        state[:, -1] = component
        for _, _, prior, own in _groups(self.priors, component):
            state[own, :-1] = prior.start(pose, int(own.sum()), rng)
        return state

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from the mixture for each of (N, D) states, `dt_s` seconds later."""
        return self._move(state, stratified_choice(self.weights, len(state), rng), dt_s, rng)[0]

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D) by priors chosen by their shares, and the log weights (N,) that correct for it.

        A prior that draws from a proposal of its own does so, and its correction is in the weights.
        """
        moved, own_correction = self._move(state, stratified_choice(self.shares, len(state), rng), dt_s, rng)
        return moved, self.log_correction(moved) + own_correction

    def log_correction(self, state: FloatArray) -> FloatArray:
        """log(π_k / κ_k), (N,), of states (N, D) whose k were chosen by the shares κ; −∞ where π_k is zero."""
        correction = np.full(len(self.weights), -np.inf)
        possible = self.weights > 0.0
        correction[possible] = np.log(self.weights[possible] / self.shares[possible])
        return correction[state[:, -1].astype(np.int64)]

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        return next(iter(self.priors.values())).pose(np.ascontiguousarray(state[:, :-1]))

    def _move(
        self, state: FloatArray, component: IntArray, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        moved, log_weights = np.empty_like(state), np.zeros(len(state))
        moved[:, -1] = component
        for _, _, prior, own in _groups(self.priors, component):
            common = np.ascontiguousarray(state[own, :-1])
            moved[own, :-1], log_weights[own] = propose(prior, common, dt_s, rng)
        return moved, log_weights


@dataclass(frozen=True, eq=False)
class MixtureDensity:
    """p(s_t | s_t−1) = Σ_k π_k p_k(s_t | s_t−1) over the common columns; which k it was follows from them.

    Of every prior the columns that follow from others must be the same.
    """

    densities: Sequence[Density]
    weights: FloatArray

    @property
    def free(self) -> IntArray:
        """The priors' free columns."""
        return self.densities[0].free

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where the likeliest prior takes states (N, D) in `dt_s` seconds when its noise is zero, (N, D)."""
        k = int(np.argmax(self.weights))
        moved = self.densities[k].mean(np.ascontiguousarray(state[:, :-1]), dt_s)
        return np.concatenate([moved, np.full((len(state), 1), float(k))], axis=1)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast."""
        return scipy.special.logsumexp(self._log_terms(previous, state, dt_s), axis=0)

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """The states (N, D) with k drawn from its posterior ∝ π_k p_k, and then what follows from others by prior k.

        A state that no prior leads to has its k drawn from π.
        """
        terms = self._log_terms(previous, state, dt_s)
        possible = np.isfinite(terms).any(axis=0)
        with np.errstate(divide="ignore"):
            terms = np.where(possible, terms, np.log(self.weights)[:, None])
        edges = np.cumsum(np.exp(terms - terms.max(axis=0)), axis=0)
        component = (edges <= rng.random(len(state)) * edges[-1]).sum(axis=0)
        completed = np.concatenate([state[:, :-1], component[:, None].astype(np.float64)], axis=1)
        for k, density in enumerate(self.densities):
            if (own := component == k).any():
                completed[own, :-1] = density.complete(
                    np.ascontiguousarray(previous[own, :-1]), np.ascontiguousarray(state[own, :-1]), dt_s, rng
                )
        return completed

    def _log_terms(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log π_k p_k(state | previous), (K, ...)."""
        before, after = np.ascontiguousarray(previous[..., :-1]), np.ascontiguousarray(state[..., :-1])
        terms = np.stack([density.log_transition(before, after, dt_s) for density in self.densities])
        with np.errstate(divide="ignore"):
            log_weights: FloatArray = np.log(self.weights)
        return terms + log_weights.reshape(-1, *[1] * (terms.ndim - 1))


@runtime_checkable
class Enterable(Protocol):
    """A prior that can take a particle over from another one without losing its velocity."""

    def enter(self, poses: FloatArray, velocities: FloatArray) -> FloatArray:
        """The states (N, D) of poses (N, P) that move with velocities (N, P), m/s and rad/s."""


@keeps_keys
class Switching:
    """K priors with states z of their own, among which a particle switches (Isard & Blake, ICCV 1998).

        p(k_t | k_t−1) = (1 − s) [k_t = k_t−1] + s π_k_t
        z_t ~ p_k(z_t | z_t−1)  where k_t = k_t−1;  elsewhere  z_t ~ p_k(z_t | z'),  z' ~ q_k(z' | φ_t−1, V_t−1)

    What is handed over is what all priors know: the pose φ and its velocity V, the pose's last change over its time
    (zero at the start). q_k is the new prior's `enter` where it has one and else its `start` around the pose, which
    forgets the velocity. Here π are not shares of the particles: those are inferred, and a component's total weight
    is the probability of that kind of motion given the frames.

    A state is the columns of every prior side by side, called "<prior>.<column>", then V ("velocity"), then k
    ("component"). Columns of priors other than the particle's own are zero. `step` is an exact draw.

    priors, weights: by name; the weights π sum to one. switching: s per frame at 30 Hz; over other times, 1 − s is
    taken to their power. Raises InputError when these are no probabilities.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the priors need; a switch has no density."""
        return Traits(requires=needs_of_all(keys["priors"]))

    def __init__(self, priors: Mapping[str, Prior], weights: Mapping[str, float], *, switching: float = 0.05) -> None:
        if not 0.0 <= switching <= 1.0:
            raise InputError(f"prior: switching must lie between 0 and 1, found {switching}")
        self.priors = dict(priors)
        self.weights = _probabilities("weights", priors, weights)
        self.switching = switching
        velocities = tuple(f"{name}_velocity" for name in POSE_NAMES), ("m/s",) * 3 + ("rad/s",) * (len(POSE_NAMES) - 3)
        moving = side_by_side(priors).appended("velocity", *velocities)
        self.space = moving.appended("component", ("component",), ("",))
        self.parameters = _union(priors)

    @property
    def powers(self) -> Powers:
        """Tell what the priors have in common. No density: what a particle that switches is handed over has none."""
        return Powers(smoothness=common_smoothness(self.priors), examples=all_examples(self.priors))

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), each prior's part of them by its own start."""
        component = stratified_choice(self.weights, n, rng)
        state = np.zeros((n, len(self.space)))
        state[:, -1] = component
        for _, name, prior, own in _groups(self.priors, component):
            state[own, self.space.slices[name]] = prior.start(pose, int(own.sum()), rng)
        return state

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` > 0 seconds later."""
        return self.propose(state, dt_s, rng)[0]

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the proposals of the priors that have one, and the log weights (N,) that correct for it."""
        velocity = self.space.slices["velocity"]
        before, poses = state[:, -1].astype(np.int64), self.pose(state)
        stays = rng.random(len(state)) < (1.0 - self.switching) ** (dt_s * REFERENCE_RATE_HZ)
        component = np.where(stays, before, stratified_choice(self.weights, len(state), rng))
        moved, log_weights = np.zeros_like(state), np.zeros(len(state))
        moved[:, -1] = component
        for k, name, prior, own in _groups(self.priors, component):
            columns = self.space.slices[name]
            current = np.ascontiguousarray(state[own, columns])
            if (new := before[own] != k).any():
                current[new] = _enter(prior, poses[own][new], state[own, velocity][new], rng)
            moved[own, columns], log_weights[own] = propose(prior, current, dt_s, rng)
        moved[:, velocity] = (self.pose(moved) - poses) / dt_s
        return moved, log_weights

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = np.empty((len(state), len(POSE_NAMES)))
        for _, name, prior, own in _groups(self.priors, state[:, -1].astype(np.int64)):
            poses[own] = prior.pose(np.ascontiguousarray(state[own, self.space.slices[name]]))
        return poses


def stratified_choice(probabilities: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """Components (n,) for n particles, each with the given probabilities (K,), in numbers within one of n times those.

    n equidistant positions with one random offset, shuffled: every single particle's position is uniform on [0, 1),
    and estimates from all of them vary less than from independent ones.
    """
    positions = (rng.permutation(n) + rng.random()) / n
    last = int(np.flatnonzero(probabilities)[-1])  # rounding may leave the last edge short of one
    return np.minimum(np.searchsorted(np.cumsum(probabilities), positions, side="right"), last)


def _groups(priors: Mapping[str, Prior], component: IntArray) -> Iterator[tuple[int, str, Prior, BoolArray]]:
    """Give every prior that has particles: its index, its name, itself, and a mask (N,) of its particles."""
    for k, (name, prior) in enumerate(priors.items()):
        if (own := component == k).any():
            yield k, name, prior, own


def common_smoothness(priors: Mapping[str, Prior]) -> Smoothness | None:
    """The penalty of all priors, where it is one and the same."""
    penalties = {prior.powers.smoothness for prior in priors.values()}
    return penalties.pop() if len(penalties) == 1 else None


def all_examples(priors: Mapping[str, Prior]) -> Callable[[], FloatArray] | None:
    """The examples (n, P) of all priors that have some, one after the other."""
    given = [prior.powers.examples for prior in priors.values() if prior.powers.examples is not None]
    return (lambda: np.concatenate([examples() for examples in given])) if given else None


def _enter(prior: Prior, poses: FloatArray, velocities: FloatArray, rng: np.random.Generator) -> FloatArray:
    if isinstance(prior, Enterable):
        return prior.enter(poses, velocities)
    # after resampling, many particles share a parent and so a pose, and finding a start may be dear: once per pose
    distinct, which = np.unique(poses, axis=0, return_inverse=True)
    states = np.empty((len(poses), len(prior.space)))
    for i, pose in enumerate(distinct):
        states[which == i] = prior.start(pose, int((which == i).sum()), rng)
    return states


def _union(priors: Mapping[str, Prior]) -> tuple[str, ...]:
    moved = {name for prior in priors.values() for name in prior.parameters}
    return tuple(name for name in POSE_NAMES if name in moved)


def side_by_side(priors: Mapping[str, Prior]) -> StateSpace:
    """Put columns of all priors together, called "<prior>.<column>"; slices "<prior>" and "<prior>.<group>"."""
    whole = StateSpace((), (), {})
    for name, own in ((name, prior.space) for name, prior in priors.items()):
        first = len(whole)
        whole = whole.appended(name, tuple(f"{name}.{column}" for column in own.names), own.units)
        groups = {f"{name}.{group}": slice(first + s.start, first + s.stop) for group, s in own.slices.items()}
        whole = replace(whole, slices={**whole.slices, **groups})
    return whole


def _probabilities(option: str, priors: Mapping[str, Prior], given: Mapping[str, float]) -> FloatArray:
    """The probabilities (K,) in the order of the priors."""
    if not priors:
        raise InputError("prior: a mixture needs at least one prior")
    if set(given) != set(priors):
        raise InputError(f"prior: {option} must be given for {', '.join(priors)}, found {', '.join(given) or 'none'}")
    values = np.array([given[name] for name in priors], dtype=np.float64)
    if not (values >= 0.0).all() or abs(values.sum() - 1.0) > 1e-9:
        raise InputError(f"prior: {option} must be zero or positive and sum to one, found {values.tolist()}")
    return values
