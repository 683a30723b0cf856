"""The product of several likelihoods (cues), each tempered by a weight."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from workbench.core.capabilities import Traits, combined_requirements, common_capabilities
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, FrameLikelihood, Likelihood
from workbench.core.losses import SQUARED, Loss
from workbench.core.observations import Observables, Observed
from workbench.core.residual import ResidualFunction, ResidualLikelihood, robust, scaled, stacked
from workbench.likelihoods.cues.limb_points import LimbFrameLikelihood, evaluate_jointly
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class Product:
    """The product of likelihoods, each raised to its weight:

        log p = Σ_k w_k log p_k

    Cues from the same pixels have correlated errors: with w = 1 the posterior is overconfident, and the sharpest cue
    dominates; weights below 1 temper each cue.

    terms, weights: by name. A term of weight 0 is never evaluated. The diagnostics "variance_fraction_<name>" are

        Cov(w_k log p_k, log p) / Var(log p),

    over the particles of non-zero likelihood, and sum to one; all are 0 in a run's first frame. Least squares minimises
    the residuals of all terms together, if all have residuals.

    Raises InputError if there is no term, the weights' names are not those of the terms, or a weight is negative.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the common capabilities of all terms with a weight, except derivatives, and the requirements of any
        of them."""
        used = {name: term for name, term in keys["terms"].items() if keys["weights"].get(name)}
        return Traits(common_capabilities(used), combined_requirements(used))

    terms: Mapping[str, Likelihood]
    weights: Mapping[str, float]

    def __post_init__(self) -> None:
        if not self.terms:
            raise InputError("likelihood: a product needs at least one term")
        if set(self.weights) != set(self.terms):
            weighted = ", ".join(self.weights) or "none"
            raise InputError(f"likelihood: weights: expected {', '.join(self.terms)}, found {weighted}")
        for name, weight in self.weights.items():
            if not 0.0 <= weight < np.inf:
                raise InputError(f"likelihood: the weight of {name} must be at least 0, found {weight}")

    @cached_property
    def _used(self) -> dict[str, Likelihood]:
        return {name: term for name, term in self.terms.items() if self.weights[name] > 0.0}

    def prepare(self, previous: Frame | None, frame: Frame) -> "_ProductFrameLikelihood":
        """Return the product of the frame likelihoods of every term with a weight."""
        return _ProductFrameLikelihood(self, {name: term.prepare(previous, frame) for name, term in self._used.items()})

    @cached_property
    def residual_terms(self) -> dict[str, ResidualLikelihood]:
        """The terms with a weight, by name, of a product with RESIDUALS."""
        return cast(dict[str, ResidualLikelihood], self._used)

    @property
    def observables(self) -> Observables:
        """The union of the terms' observables; standard deviations are those of the first term that has them."""
        observables = [term.observables for term in self.residual_terms.values()]
        points = next((each for each in observables if each.sigma is not None), Observables())
        keypoints = [each for each in observables if each.sigma_px is not None]
        cameras = None
        if keypoints and all(each.cameras is not None for each in keypoints):
            cameras = tuple(dict.fromkeys(name for each in keypoints for name in each.cameras or ()))
        sigma_px = keypoints[0].sigma_px if keypoints else None
        return replace(points, sigma_px=sigma_px, cameras=cameras)

    @property
    def _common_loss(self) -> Loss | None:
        """The loss that all terms share, if all weights are 1."""
        losses = {term.residual_loss for term in self.residual_terms.values()}
        return losses.pop() if len(losses) == 1 and all(self.weights[name] == 1.0 for name in self._used) else None

    @property
    def residual_loss(self) -> Loss:
        """The loss of the stacked terms: their common one, or the square if each term is made robust first."""
        return self._common_loss or SQUARED

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the stacked residuals of the terms. Without a common loss, half the square of each is its loss times
        its weight."""
        residuals = {name: term.residual_function(observed) for name, term in self.residual_terms.items()}
        if self._common_loss is None:
            for name, term in self.residual_terms.items():
                term_residual = robust(residuals[name], term.residual_loss)
                residuals[name] = scaled(term_residual, float(np.sqrt(self.weights[name])))
        return stacked(list(residuals.values()))


@dataclass(frozen=True, eq=False)
class _ProductFrameLikelihood:
    """The likelihood of one frame by the terms with a weight, `frame_likelihoods`, by name."""

    product: Product
    frame_likelihoods: Mapping[str, FrameLikelihood]

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes of all terms."""
        return tuple(note for frame_likelihood in self.frame_likelihoods.values() for note in frame_likelihood.notes)

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """The diagnostics of all terms, and a variance fraction of 0 for each."""
        return _merged(self.frame_likelihoods.values()) | {
            f"variance_fraction_{name}": 0.0 for name in self.frame_likelihoods
        }

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log likelihoods (N,) of poses (N, P) with previous poses (N, P), with the terms' fractions of their
        variance."""
        evaluations = self._evaluations(previous_pose, pose)
        weighted = {name: self.product.weights[name] * each.log_prob for name, each in evaluations.items()}
        total = sum(weighted.values(), np.zeros(len(pose)))
        fractions = variance_fractions(weighted, total)
        diagnostics = {f"variance_fraction_{name}": fraction for name, fraction in fractions.items()}
        notes = tuple(note for each in evaluations.values() for note in each.notes)
        return Evaluation(total, notes, _merged(evaluations.values()) | diagnostics)

    def _evaluations(self, previous_pose: FloatArray, pose: FloatArray) -> dict[str, Evaluation]:
        """Evaluate every term; those of the limbs of one body jointly."""
        bodies: dict[int, dict[str, LimbFrameLikelihood]] = {}
        for name, frame_likelihood in self.frame_likelihoods.items():
            if isinstance(frame_likelihood, LimbFrameLikelihood):
                bodies.setdefault(id(frame_likelihood.body), {})[name] = frame_likelihood
        evaluations: dict[str, Evaluation] = {}
        for frame_likelihoods in bodies.values():
            evaluations |= zip(frame_likelihoods, evaluate_jointly(list(frame_likelihoods.values()), pose), strict=True)
        return {
            name: evaluations[name] if name in evaluations else frame_likelihood.evaluate(previous_pose, pose)
            for name, frame_likelihood in self.frame_likelihoods.items()
        }

    def update(self, expected_pose: FloatArray) -> Product:
        """Return the product of the updated terms; a term without a weight is unchanged."""
        updated = {
            name: frame_likelihood.update(expected_pose) for name, frame_likelihood in self.frame_likelihoods.items()
        }
        return replace(self.product, terms={**self.product.terms, **updated})


def _merged(terms: Iterable[FrameLikelihood | Evaluation]) -> dict[str, float]:
    return {name: value for term in terms for name, value in term.diagnostics.items()}


def variance_fractions(terms: Mapping[str, FloatArray], total: FloatArray) -> dict[str, float]:
    """Return Cov(term, total) / Var(total) over the particles (N,) of finite total; 0 for all terms if the variance is
    0."""
    finite = np.isfinite(total)
    centred = total[finite] - total[finite].mean() if finite.any() else np.zeros(0)
    squares = float((centred**2).sum())
    return {name: float((term[finite] * centred).sum()) / squares if squares else 0.0 for name, term in terms.items()}
