"""A particle filter whose proposal is a fit of all frames (paper D, section 1, which suggests the combination)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Protocol, cast

import numpy as np

from workbench.core.capabilities import ACTIVITY, START, Traits, combined_requirements, component_traits
from workbench.core.checks import BELOW_1, POSITIVE, check
from workbench.core.frame import Frame, repeatable
from workbench.core.frame_cache import without_images
from workbench.core.prior import Prior
from workbench.core.step import Step
from workbench.inference.smc.move import Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.target import MoveResult, Target
from workbench.utils.arrays import FloatArray

INITIAL_SPEED_STD = 0.1
NO_PROPOSAL = "hybrid: the filter's algorithm does not use a proposal; the fit only sets the initial pose"


class _FittablePrior(Prior, Protocol):
    """A prior with ACTIVITY, whose motion can be fitted: a Gaussian over the columns that its poses depend on.

    driven: those D' columns, {coefficients, phase, root position, root rotation}, in the order of the fit's states. The
    space names "phase", "phase_speed" and "root_velocity".
    """

    @property
    def driven(self) -> list[int]: ...

    def predicted(self, state: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return means (N, D') and standard deviations (D',) of the driven columns, `dt_s` seconds after states (N, D).

        The phase is not wrapped.
        """


class _Fitter(Protocol):
    """An estimator of all frames at once, such as `LeastSquares`."""

    def fit_frames(self, frames: Sequence[Frame], start: FloatArray | None, rng: np.random.Generator) -> Any:
        """Return the fit (states (T, D'), state_covariance (T, D', D'), poses (T, P), iterations), the observations
        used of each frame, and the warnings of each, from an initial pose `start` (P,), or None to estimate it."""


@dataclass(frozen=True, eq=False)
class Hybrid(Wrapper):
    """Fit all frames, then filter with a proposal that is a mixture of that fit and the prior:

        s_t ~ ρ · c N(s_t; fit_t, λ² Σ_t) p(s_t | s_t−1) + (1 − ρ) · p(s_t | s_t−1)

    weighted by p(s_t | s_t−1) over that density, where s_t is {α, μ, root}, ρ the proposal_fraction, λ the
    std_inflation and c the normalising constant. The posterior is the filter's; the fit, which depends on all frames,
    is only a proposal. Moves without a proposal use only its initial pose, of which the first step warns.

    filter: for a prior with a motion. std_inflation: factor of the fit's standard deviations, as its covariance treats
    the points as independent. Raises InputError for numbers out of range.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the requirements of the filter and the fit, except for an initial pose."""
        parts = {"filter": keys["filter"], "fit": keys["fitter"], "proposal": component_traits(prior=ACTIVITY)}
        requires = combined_requirements(parts)
        return Traits(requires={**requires, "dataset": requires["dataset"] - {START}})  # the fit estimates it

    fitter: _Fitter
    _: KW_ONLY
    proposal_fraction: float = 0.7
    std_inflation: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check("inference", self, proposal_fraction=BELOW_1, std_inflation=POSITIVE)

    @property
    def finds_start(self) -> bool:
        """Return True: the fit estimates the initial pose."""
        return True

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame once all are fitted, from an initial pose `start` (P,), or None to estimate it.

        rng_streams: as for the filter. Raises InputError if there is nothing to fit.
        """
        frames = repeatable(frames)
        observed = list(without_images(frames))
        fit, _, warnings = self.fitter.fit_frames(observed, start, rng_streams["start"])
        prior, times_s = cast(_FittablePrior, self.prior), np.array([frame.time_s for frame in observed])
        covariances = self.std_inflation**2 * fit.state_covariance
        priors = proposal_priors(prior, fit.states, covariances, times_s, self.proposal_fraction)
        by_frame = {frame.index: each for frame, each in zip(observed, priors, strict=True)}

        def move_with_proposal(move: Move, target: Target, rng_streams: Streams) -> MoveResult:
            return move(replace(target, prior=by_frame[target.frame.index]), rng_streams)

        if not self.algorithm.proposes:
            warnings[0] = (*warnings[0], NO_PROPOSAL)
        wrapped = self.filter.rebuilt(prior=priors[0], algorithm=WrappedMove(self.algorithm, move_with_proposal))
        for step, more in zip(wrapped.run(frames, fit.poses[0], rng_streams), warnings, strict=True):
            evaluations = step.evaluations + fit.iterations
            yield replace(step, warnings=step.warnings + more, evaluations=evaluations)


class _ProposalPrior:
    """A prior with a proposal for one frame, which multiplies it by a Gaussian over its driven columns.

    mean: (D',). covariance: (D', D'). speeds: (D',), per second, of the initial states. fraction: of the proposal.
    """

    def __init__(
        self, prior: _FittablePrior, mean: FloatArray, covariance: FloatArray, speeds: FloatArray, fraction: float
    ) -> None:
        self.prior, self.mean, self.covariance, self.speeds, self.fraction = prior, mean, covariance, speeds, fraction
        self.space, self.parameters, self.capabilities = prior.space, prior.parameters, prior.capabilities
        self.sample_transition, self.pose = prior.sample_transition, prior.pose
        # the phase follows the coefficients and precedes the root's position
        self._phase = prior.driven.index(prior.space.slices["phase"].start)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample N states from the Gaussian, with standard deviations of the speeds of 0.1 m/s and cycles/s."""
        state, slices, driven = self.prior.sample_initial(pose, n, rng), self.space.slices, self.prior.driven
        values, vectors = np.linalg.eigh(self.covariance)
        deviations = rng.standard_normal((n, len(driven))) * np.sqrt(np.maximum(values, 0.0))
        state[:, driven] = self.mean + deviations @ vectors.T
        state[:, slices["phase"]] %= 1.0
        phase = self._phase
        for name, columns in (("phase_speed", slice(phase, phase + 1)), ("root_velocity", slice(phase + 1, phase + 4))):
            noise = INITIAL_SPEED_STD * rng.standard_normal(state[:, slices[name]].shape)
            state[:, slices[name]] = self.speeds[columns] + noise
        return state

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample states (N, D) from the mixture; return them and their log importance weights (N,) for the prior.

        The product of the fit's Gaussian and p(s_t | s_t−1) is a Gaussian whose mean depends on the particle.
        """
        driven, phase = self.prior.driven, self._phase
        predicted, sigma = self.prior.predicted(state, dt_s)
        fitted = np.repeat(self.mean[None], len(state), axis=0)  # at the phase nearest to the particle's
        fitted[:, phase] += np.round(predicted[:, phase] - fitted[:, phase])

        precision_fit, precision_prior = np.linalg.inv(self.covariance), 1.0 / sigma**2
        product = np.linalg.inv(precision_fit + np.diag(precision_prior))
        mean = (fitted @ precision_fit + predicted * precision_prior) @ product
        factor = np.linalg.cholesky(product)
        white = rng.standard_normal((len(state), len(driven)))
        from_fit = rng.random(len(state)) < self.fraction

        proposed = self.prior.sample_transition(state, dt_s, rng)
        sampled = np.where(from_fit[:, None], mean + white @ factor.T, proposed[:, driven])
        sampled[:, phase] += np.round(mean[:, phase] - sampled[:, phase])
        log_product = _log_gaussian((sampled - mean) @ np.linalg.inv(factor).T, np.diag(factor))
        log_prior = _log_gaussian((sampled - predicted) / sigma, sigma)
        proposed[:, driven] = sampled
        proposed[:, self.space.slices["phase"]] %= 1.0
        with np.errstate(divide="ignore"):
            log_mixture = np.logaddexp(np.log(self.fraction) + log_product, np.log1p(-self.fraction) + log_prior)
        return proposed, log_prior - log_mixture


def proposal_priors(
    prior: _FittablePrior, means: FloatArray, covariances: FloatArray, times_s: FloatArray, fraction: float
) -> list[_ProposalPrior]:
    """Return the prior with a proposal for each of T frames.

    Parameters
    ----------
    prior : of the motion.
    means, covariances : (T, D'), (T, D', D'), of the driven columns.
    times_s : (T,), s.
    fraction : of the proposal in the mixture.
    """
    dt_s = float(times_s[1] - times_s[0]) if len(times_s) > 1 else 1.0
    speeds = (means[min(1, len(means) - 1)] - means[0]) / dt_s
    return [
        _ProposalPrior(prior, mean, covariance, speeds, fraction)
        for mean, covariance in zip(means, covariances, strict=True)
    ]


def _log_gaussian(white: FloatArray, scales: FloatArray) -> FloatArray:
    """Return log N (N,) of whitened deviations (N, D'), with the diagonal (D',) of the whitening factor."""
    constant = float(np.log(np.sqrt(2.0 * np.pi) * scales).sum())
    return -0.5 * (white**2).sum(axis=1) - constant
