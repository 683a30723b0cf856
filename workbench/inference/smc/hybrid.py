"""A particle filter that looks where a fit of all frames ended (paper D, section 1: the two could be combined)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from workbench.core.capabilities import ACTIVITY, START, Traits, combined_requirements, component_traits
from workbench.core.checks import BELOW_1, POSITIVE, check
from workbench.core.frame import Frame
from workbench.core.prior import Prior
from workbench.core.step import Step
from workbench.inference.smc.move import Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.target import MoveResult, Target
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

START_SPEED_SIGMA = 0.1
UNGUIDED = "hybrid: the filter's move draws from no proposal; the fit gave the start, and guided nothing after it"


@runtime_checkable
class _Driven(Prior, Protocol):
    """A prior of a motion that can be fitted: a Gaussian over the columns that its poses depend on.

    driven: those D' columns, {coefficients, phase, root position, root rotation}, as the fit's states have them. The
    space names "phase", "phase_speed" and "root_velocity".
    """

    @property
    def driven(self) -> list[int]: ...

    def predicted(self, state: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return means (N, D') and deviations (D',) of the driven columns, `dt_s` seconds after states (N, D); the
        phase is counted on, without wrapping."""


class _Fitter(Protocol):
    """What fits all frames at once; such as `LeastSquares`."""

    def fit_frames(self, frames: Sequence[Frame], start: FloatArray | None, rng: np.random.Generator) -> Any:
        """Return the fit (states (T, D'), state_covariance (T, D', D'), poses (T, P), iterations), what was used of
        each frame, and what there is to say about each, from about the pose `start` (P,), or None to find the
        person."""


@dataclass(frozen=True, eq=False)
class Hybrid(Wrapper):
    """Fit all frames, then filter with a proposal that is mixed of that fit and the prior:

        s_t ~ share · c N(s_t; fit_t, widen² Σ_t) p(s_t | s_t−1) + (1 − share) · p(s_t | s_t−1)

    weighted by p(s_t | s_t−1) over that density, s_t being {α, μ, root} and c the normalising constant. The posterior
    is the filter's; the fit, which has seen all frames, is only a proposal. Moves that draw from no proposal get the
    start only, of which the first step warns.

    filter: for a prior with a motion. share: of the proposal. widen: factor of the fit's deviations, since its
    covariance takes the points for independent. Raises InputError for numbers out of range and another prior."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the filter and the fit need, but a start."""
        parts = {"filter": keys["filter"], "fit": keys["fitter"], "proposal": component_traits(prior=ACTIVITY)}
        needs = combined_requirements(parts)
        return Traits(requires={**needs, "dataset": needs["dataset"] - {START}})  # which the fit finds

    fitter: _Fitter
    _: KW_ONLY
    proposal_fraction: float = 0.7
    std_inflation: float = 6.0

    resumable: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        _driven_prior(self.prior)
        check("inference", self, proposal_fraction=BELOW_1, std_inflation=POSITIVE)

    @property
    def finds_start(self) -> bool:
        """Return True: the fit finds it."""
        return True

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame once all are fitted, from about the pose `start` (P,), or None to find the person.
        rng_streams: as for the filter. Raises InputError when there is nothing to fit."""
        frames = list(frames)
        fit, _, warnings = self.fitter.fit_frames(frames, start, rng_streams["start"])
        prior, times_s = _driven_prior(self.prior), np.array([frame.time_s for frame in frames])
        guides = guides_of(
            prior, fit.states, self.std_inflation**2 * fit.state_covariance, times_s, self.proposal_fraction
        )
        by_frame = {frame.index: guide for frame, guide in zip(frames, guides, strict=True)}

        def guide_move(move: Move, target: Target, rng_streams: Streams) -> MoveResult:
            return move(replace(target, prior=by_frame[target.frame.index]), rng_streams)

        if not self.algorithm.proposes:
            warnings[0] = (*warnings[0], UNGUIDED)
        guided = self.filter.rebuilt(prior=guides[0], algorithm=WrappedMove(self.algorithm, guide_move))
        for step, more in zip(guided.run(frames, fit.poses[0], rng_streams), warnings, strict=True):
            more_evaluations = step.evaluations + fit.iterations
            yield replace(step, warnings=step.warnings + more, evaluations=more_evaluations, filter_state=None)


def _driven_prior(prior: Prior) -> _Driven:
    """Return the prior itself; raises InputError where it has no motion to fit."""
    if prior.capabilities.motion is None or not isinstance(prior, _Driven):
        raise InputError(
            f"inference: hybrid needs a prior with a motion model to fit, such as prior=activity, "
            f"found {type(prior).__name__.lower()}"
        )
    return prior


class _Guided:
    """A prior, with a proposal for one frame that is drawn towards a Gaussian over its driven columns. mean: (D',).
    covariance: (D', D'). speeds: (D',), a second, with which states start."""

    def __init__(
        self, prior: _Driven, mean: FloatArray, covariance: FloatArray, speeds: FloatArray, fraction: float
    ) -> None:
        self.prior, self.mean, self.covariance, self.speeds, self.fraction = prior, mean, covariance, speeds, fraction
        self.space, self.parameters, self.capabilities = prior.space, prior.parameters, prior.capabilities
        self.sample_transition, self.pose = prior.sample_transition, prior.pose
        # the phase comes behind the coefficients and before the root's position
        self._turn = prior.driven.index(prior.space.slices["phase"].start)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw N states from the Gaussian, with the speeds to 0.1 m/s and cycles/s."""
        state, slices, driven = self.prior.sample_initial(pose, n, rng), self.space.slices, self.prior.driven
        values, vectors = np.linalg.eigh(self.covariance)
        spread = rng.standard_normal((n, len(driven))) * np.sqrt(np.maximum(values, 0.0))
        state[:, driven] = self.mean + spread @ vectors.T
        state[:, slices["phase"]] %= 1.0
        turn = self._turn
        for name, columns in (("phase_speed", slice(turn, turn + 1)), ("root_velocity", slice(turn + 1, turn + 4))):
            noise = START_SPEED_SIGMA * rng.standard_normal(state[:, slices[name]].shape)
            state[:, slices[name]] = self.speeds[columns] + noise
        return state

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw (N, D) from the mixture, with the log weights (N,) by which draws stand for the prior. The product of
        the fit's Gaussian and p(s_t | s_t−1) is a Gaussian whose mean depends on the particle."""
        driven, turn = self.prior.driven, self._turn
        predicted, sigma = self.prior.predicted(state, dt_s)
        target = np.repeat(self.mean[None], len(state), axis=0)  # at the phase that is nearest to the particle's
        target[:, turn] += np.round(predicted[:, turn] - target[:, turn])

        precision_fit, precision_prior = np.linalg.inv(self.covariance), 1.0 / sigma**2
        product = np.linalg.inv(precision_fit + np.diag(precision_prior))
        middle = (target @ precision_fit + predicted * precision_prior) @ product
        factor = np.linalg.cholesky(product)
        white = rng.standard_normal((len(state), len(driven)))
        guided = rng.random(len(state)) < self.fraction

        moved = self.prior.sample_transition(state, dt_s, rng)
        drawn = np.where(guided[:, None], middle + white @ factor.T, moved[:, driven])
        drawn[:, turn] += np.round(middle[:, turn] - drawn[:, turn])
        log_product = _log_gaussian((drawn - middle) @ np.linalg.inv(factor).T, np.diag(factor))
        log_prior = _log_gaussian((drawn - predicted) / sigma, sigma)
        moved[:, driven] = drawn
        moved[:, self.space.slices["phase"]] %= 1.0
        with np.errstate(divide="ignore"):
            log_mixture = np.logaddexp(np.log(self.fraction) + log_product, np.log1p(-self.fraction) + log_prior)
        return moved, log_prior - log_mixture


def guides_of(
    prior: _Driven, means: FloatArray, covariances: FloatArray, times_s: FloatArray, fraction: float
) -> list[_Guided]:
    """Guide the prior in each of T frames at times (T,), s, towards means (T, D') with covariances (T, D', D')."""
    dt_s = float(times_s[1] - times_s[0]) if len(times_s) > 1 else 1.0
    speeds = (means[min(1, len(means) - 1)] - means[0]) / dt_s
    return [
        _Guided(prior, mean, covariance, speeds, fraction) for mean, covariance in zip(means, covariances, strict=True)
    ]


def _log_gaussian(white: FloatArray, scales: FloatArray) -> FloatArray:
    """Return log N (N,) of whitened deviations (N, D'), with the diagonal (D',) of the factor that whitens."""
    constant = float(np.log(np.sqrt(2.0 * np.pi) * scales).sum())
    return -0.5 * (white**2).sum(axis=1) - constant
