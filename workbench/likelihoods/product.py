"""Several cues at once: the product of likelihoods, each tempered so that none silences the rest."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from workbench.core.capabilities import DERIVATIVES, Traits, needs_of_all, offers_of_all
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, FrameLikelihood, Likelihood
from workbench.core.observations import Observables, Observed
from workbench.core.residual import SQUARED, Loss, ResidualFunction, ResidualLikelihood, robust, scaled, stacked
from workbench.likelihoods.cues.limb_points import LimbLook, evaluate_together
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class Product:
    """The product of likelihoods, each taken to the power of its weight:

        log p = Σ_k w_k log p_k

    Cues of the same pixels err together, so that w = 1 is too sure of itself, and the sharpest cue decides alone;
    weights below 1 temper both.

    terms, weights: by name. A term of weight 0 is never evaluated. The diagnostics "variance_fraction_<name>" are

        share_k = Cov(w_k log p_k, log p) / Var(log p),

    over the particles whose likelihood is not zero, and sum to one; all are 0 in a run's first frame. Least squares
    minimises the residuals of all terms together, where all have some.
    Raises InputError when there is no term, or the weights are not those of the terms or negative.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what all terms with a weight offer but derivatives, and what any of them needs."""
        used = {name: term for name, term in keys["terms"].items() if keys["weights"].get(name)}
        return Traits(offers_of_all(used) - {DERIVATIVES}, needs_of_all(used))

    terms: Mapping[str, Likelihood]
    weights: Mapping[str, float]

    def __post_init__(self) -> None:
        if not self.terms:
            raise InputError("likelihood: a product needs at least one term")
        if set(self.weights) != set(self.terms):
            found = ", ".join(self.weights) or "none"
            raise InputError(f"likelihood: weights must be given for {', '.join(self.terms)}, found {found}")
        for name, weight in self.weights.items():
            if not 0.0 <= weight < np.inf:
                raise InputError(f"likelihood: the weight of {name} must be at least 0, found {weight}")

    @cached_property
    def _used(self) -> dict[str, Likelihood]:
        return {name: term for name, term in self.terms.items() if self.weights[name] > 0.0}

    def prepare(self, previous: Frame | None, frame: Frame) -> "_ProductLook":
        """Let every term with a weight look."""
        return _ProductLook(self, {name: term.prepare(previous, frame) for name, term in self._used.items()})

    @cached_property
    def residual_terms(self) -> dict[str, ResidualLikelihood]:
        """The terms that have a weight, by name; raises InputError where one of them has no residuals."""
        terms: dict[str, ResidualLikelihood] = {}
        terms |= {name: term for name, term in self._used.items() if isinstance(term, ResidualLikelihood)}
        if lacking := [name for name in self._used if name not in terms]:
            needed = "least squares needs residuals of every term of a product"
            raise InputError(f"likelihood: {needed}, {lacking[0]} has none; give it the weight 0")
        return terms

    @property
    def observables(self) -> Observables:
        """Join all that some term looks at; deviations are those of the first term that has them."""
        every = [term.observables for term in self.residual_terms.values()]
        points = next((each for each in every if each.sigma is not None), Observables())
        keypoints = [each for each in every if each.sigma_px is not None]
        cameras = None
        if keypoints and all(each.which is not None for each in keypoints):
            cameras = tuple(dict.fromkeys(name for each in keypoints for name in each.which or ()))
        sigma_px = keypoints[0].sigma_px if keypoints else None
        return Observables(points.sigma, points.kind, sigma_px, cameras, points.shared_m)

    @property
    def _common_loss(self) -> Loss | None:
        """The loss that all terms have, where all weights are 1."""
        losses = {term.residual_loss for term in self.residual_terms.values()}
        return losses.pop() if len(losses) == 1 and all(self.weights[name] == 1.0 for name in self._used) else None

    @property
    def residual_loss(self) -> Loss:
        """The loss of the stacked terms: their common one, or the square where each is made robust first."""
        return self._common_loss or SQUARED

    def residual(self, observed: Observed) -> ResidualFunction:
        """Stack the terms in order. Without a common loss, half the square of each is its own loss times its weight."""
        residuals = {name: term.residual(observed) for name, term in self.residual_terms.items()}
        if self._common_loss is None:
            for name, term in self.residual_terms.items():
                own = robust(residuals[name], term.residual_loss)
                residuals[name] = scaled(own, float(np.sqrt(self.weights[name])))
        return stacked(list(residuals.values()))


@dataclass(frozen=True, eq=False)
class _ProductLook:
    """A look at one frame by the terms of a product: `frame_likelihoods`, by name, of those with a weight."""

    product: Product
    frame_likelihoods: Mapping[str, FrameLikelihood]

    @property
    def notes(self) -> tuple[str, ...]:
        """Collect those of the terms."""
        return tuple(note for frame_likelihood in self.frame_likelihoods.values() for note in frame_likelihood.notes)

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """Collect those of the terms, and a share of 0 for each."""
        return _merged(self.frame_likelihoods.values()) | {
            f"variance_fraction_{name}": 0.0 for name in self.frame_likelihoods
        }

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P), with the shares of the terms."""
        evaluations = self._evaluations(previous_pose, pose)
        parts = {name: self.product.weights[name] * each.log_prob for name, each in evaluations.items()}
        total = sum(parts.values(), np.zeros(len(pose)))
        diagnostics = {f"variance_fraction_{name}": share for name, share in shares(parts, total).items()}
        notes = tuple(note for each in evaluations.values() for note in each.notes)
        return Evaluation(total, notes, _merged(evaluations.values()) | diagnostics)

    def _evaluations(self, previous_pose: FloatArray, pose: FloatArray) -> dict[str, Evaluation]:
        """Evaluate every term, together those that look at the limbs of one body."""
        bodies: dict[int, dict[str, LimbLook]] = {}
        for name, frame_likelihood in self.frame_likelihoods.items():
            if isinstance(frame_likelihood, LimbLook):
                bodies.setdefault(id(frame_likelihood.body), {})[name] = frame_likelihood
        together: dict[str, Evaluation] = {}
        for frame_likelihoods in bodies.values():
            together |= zip(frame_likelihoods, evaluate_together(list(frame_likelihoods.values()), pose), strict=True)
        return {
            name: together[name] if name in together else frame_likelihood.evaluate(previous_pose, pose)
            for name, frame_likelihood in self.frame_likelihoods.items()
        }

    def update(self, expected_pose: FloatArray) -> Product:
        """The product of what the terms remember; a term without a weight stays as it is."""
        remembering = {
            name: frame_likelihood.update(expected_pose) for name, frame_likelihood in self.frame_likelihoods.items()
        }
        return replace(self.product, terms={**self.product.terms, **remembering})


def _merged(parts: Iterable[FrameLikelihood | Evaluation]) -> dict[str, float]:
    return {name: value for part in parts for name, value in part.diagnostics.items()}


def shares(parts: Mapping[str, FloatArray], total: FloatArray) -> dict[str, float]:
    """Cov(part, total) / Var(total) over the particles (N,) with a finite total; 0 for all where nothing varies."""
    finite = np.isfinite(total)
    centred = total[finite] - total[finite].mean() if finite.any() else np.zeros(0)
    spread = float((centred**2).sum())
    return {name: float((part[finite] * centred).sum()) / spread if spread else 0.0 for name, part in parts.items()}
