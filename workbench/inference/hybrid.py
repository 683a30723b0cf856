"""A particle filter that looks where least squares ended (paper D, section 6: the two could be combined)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.limbs import Body
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.least_squares import LeastSquares
from workbench.inference.particle_filter import ParticleFilter
from workbench.inference.step import Step
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.activity import Activity
from workbench.priors.state import Prior, StateSpace

START_SPEED_SIGMA = 0.1


class Hybrid:
    """Fits all frames by least squares, then filters with a proposal that is mixed of that fit and the prior:

        s_t ~ share · c N(s_t; fit_t, widen² Σ_t) p(s_t | s_t−1) + (1 − share) · p(s_t | s_t−1)

    weighted by p(s_t | s_t−1) over that density, s_t being {α, μ, root} and c what makes the product a density. The
    posterior is the filter's, with the likelihood and the prior as they are; the fit says only where to look. As it has
    seen all frames, this is no filter for a camera that is still running. The prior's speeds are drawn from the prior.

    n_particles, ess_threshold: as for the particle filter. share: of the proposal. widen: the fit's deviations times
    this, since its covariance takes the points for independent. phase_ends: as for `LeastSquares`, whose defaults are
    used otherwise. Raises InputError for numbers out of range and another prior than `Activity`.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        body: Body,
        phase_ends: tuple[float, float] | None = None,
        *,
        n_particles: int = 500,
        share: float = 0.7,
        widen: float = 6.0,
        ess_threshold: float = 1.0,
    ) -> None:
        if not isinstance(prior, Activity):
            raise InputError("inference: hybrid needs a prior with a motion model to fit, prior=activity")
        if not (0.0 <= share < 1.0 and 0.0 < widen < np.inf):
            raise InputError(f"inference: share must lie in 0 to below 1 and widen above 0, found {share} and {widen}")
        self.prior, self.likelihood = prior, likelihood
        self.fitter = LeastSquares(body, prior.model, phase_ends)
        self.share, self.widen = share, widen
        self.n_particles, self.ess_threshold = n_particles, ess_threshold

    @property
    def space(self) -> StateSpace:
        """The prior's."""
        return self.prior.space

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame once all are fitted, from about the pose `start` (P,), or None to find the person.

        rng_streams: generators named "start", "resampling" and "prior". Raises InputError when there is nothing to fit.
        """
        frames = list(frames)
        fit, _, warnings = self.fitter.fit_frames(frames, start, rng_streams["start"])
        times_s = np.array([frame.time_s for frame in frames])
        guided = Guided(self.prior, fit.states, self.widen**2 * fit.state_covariance, times_s, self.share)
        inference = ParticleFilter(
            guided, self.likelihood, n_particles=self.n_particles, ess_threshold=self.ess_threshold
        )
        for step, said in zip(inference.run(frames, fit.poses[0], rng_streams), warnings, strict=True):
            yield replace(step, warnings=step.warnings + said, evaluations=step.evaluations + fit.iterations)


class Guided:
    """The prior, with a proposal for every step that is drawn towards that step's Gaussian over {α, μ, root}.

    means: (T, D'). covariances: (T, D', D'). times_s: (T,). `start` uses the first, then each `propose` the next.
    """

    def __init__(
        self, prior: Activity, means: FloatArray, covariances: FloatArray, times_s: FloatArray, share: float
    ) -> None:
        self.prior, self.share = prior, share
        self.space, self.parameters = prior.space, prior.parameters
        self._gaussians = iter(list(zip(means, covariances, strict=True)))
        dt_s = float(times_s[1] - times_s[0]) if len(times_s) > 1 else 1.0
        self._speeds = (means[min(1, len(means) - 1)] - means[0]) / dt_s

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states from the first frame's Gaussian, with the speeds that the fit has there to 0.1 m/s and cycles/s."""
        mean, covariance = next(self._gaussians)
        state, slices, driven = self.prior.start(pose, n, rng), self.prior.space.slices, self.prior.driven
        values, vectors = np.linalg.eigh(covariance)
        spread = rng.standard_normal((n, len(driven))) * np.sqrt(np.maximum(values, 0.0))
        state[:, driven] = mean + spread @ vectors.T
        state[:, slices["phase"]] %= 1.0
        d = len(self.prior.model.scales)
        for name, columns in (("phase_speed", slice(d, d + 1)), ("root_velocity", slice(d + 1, d + 4))):
            noise = START_SPEED_SIGMA * rng.standard_normal(state[:, slices[name]].shape)
            state[:, slices[name]] = self._speeds[columns] + noise
        return state

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """The prior's."""
        return self.prior.step(state, dt_s, rng)

    def pose(self, state: FloatArray) -> FloatArray:
        """The prior's."""
        return self.prior.pose(state)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D) from the mixture and the log weights (N,) by which they stand for the prior.

        The product of the fit's Gaussian and p(s_t | s_t−1) is a Gaussian whose mean depends on the particle.
        """
        mean, covariance = next(self._gaussians)
        driven, turn = self.prior.driven, self.prior.driven.index(self.prior.space.slices["phase"].start)
        predicted, sigma = self.prior.predicted(state, dt_s)
        target = np.repeat(mean[None], len(state), axis=0)  # at the phase that is nearest to the particle's
        target[:, turn] += np.round(predicted[:, turn] - target[:, turn])

        precision_fit, precision_prior = np.linalg.inv(covariance), 1.0 / sigma**2
        product = np.linalg.inv(precision_fit + np.diag(precision_prior))
        middle = (target @ precision_fit + predicted * precision_prior) @ product
        factor = np.linalg.cholesky(product)
        white = rng.standard_normal((len(state), len(driven)))
        guided = rng.random(len(state)) < self.share

        moved = self.prior.step(state, dt_s, rng)
        drawn = np.where(guided[:, None], middle + white @ factor.T, moved[:, driven])
        drawn[:, turn] += np.round(middle[:, turn] - drawn[:, turn])
        log_product = _log_gaussian((drawn - middle) @ np.linalg.inv(factor).T, np.diag(factor))
        log_prior = _log_gaussian((drawn - predicted) / sigma, sigma)
        moved[:, driven] = drawn
        moved[:, self.prior.space.slices["phase"]] %= 1.0
        with np.errstate(divide="ignore"):
            log_mixture = np.logaddexp(np.log(self.share) + log_product, np.log1p(-self.share) + log_prior)
        return moved, log_prior - log_mixture


def _log_gaussian(white: FloatArray, scales: FloatArray) -> FloatArray:
    """log N (N,) of whitened deviations (N, D'), with the diagonal (D',) of the triangular factor that whitens."""
    constant = float(np.log(np.sqrt(2.0 * np.pi) * scales).sum())
    density: FloatArray = -0.5 * (white**2).sum(axis=1) - constant
    return density
