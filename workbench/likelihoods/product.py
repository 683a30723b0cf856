"""Several cues at once: the product of likelihoods, each tempered so that none silences the rest."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.arrays import FloatArray
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, Likelihood, Look
from workbench.core.observations import Observables, Observed
from workbench.core.residual import Loss, ResidualFunction
from workbench.core.traits import Traits, needs_of_all, offers_of_all
from workbench.errors import InputError
from workbench.likelihoods.residuals import joint_observables, product_loss, product_residual, residual_terms


@dataclass(frozen=True, eq=False)
class Product:
    """The product of likelihoods, each taken to the power of its weight:

        log p = Σ_k w_k log p_k

    Cues that look at the same pixels err together, so the plain product (w = 1) is too sure of itself; and a cue that
    is much sharper than the others decides alone. Weights below 1 temper both.

    terms, weights: by name. A term of weight 0 is never evaluated; without any other, every pose is equally likely.
    Of every frame are told, as "share_<name>", the parts of the terms in what tells the particles apart,

        share_k = Cov(w_k log p_k, log p) / Var(log p),

    over the particles whose likelihood is not zero. They sum to one; a cue that contradicts the others is below zero.
    In a run's first frame, which is given, all are 0.

    Least squares minimises the residuals of all terms together, where all have some.
    Raises InputError when there is no term, or the weights are not those of the terms or negative.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what all terms with a weight offer, and what any of them needs."""
        used = {name: term for name, term in keys["terms"].items() if keys["weights"].get(name)}
        return Traits(offers_of_all(used), needs_of_all(used))

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

    def look(self, previous: Frame | None, frame: Frame) -> "ProductLook":
        """Let every term with a weight look."""
        used = {name: term for name, term in self.terms.items() if self.weights[name] > 0.0}
        return ProductLook(self, {name: term.look(previous, frame) for name, term in used.items()})

    @property
    def observables(self) -> Observables:
        """Tell what the terms look at, where all have residuals; else InputError."""
        return joint_observables(residual_terms(self.terms, self.weights))

    @property
    def residual_loss(self) -> Loss:
        """The loss of the terms' residuals, see `residuals.product_loss`."""
        return product_loss(residual_terms(self.terms, self.weights), self.weights)

    def residual(self, observed: Observed) -> ResidualFunction:
        """Stack those of the terms in their order; see `residuals.product_residual`."""
        return product_residual(residual_terms(self.terms, self.weights), self.weights, observed)


@dataclass(frozen=True, eq=False)
class ProductLook:
    """What the terms of a product have seen of one frame: `looks`, by name, of those with a weight."""

    product: Product
    looks: Mapping[str, Look]

    @property
    def notes(self) -> tuple[str, ...]:
        """Collect those of the terms."""
        return tuple(note for look in self.looks.values() for note in look.notes)

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """Collect those of the terms, and a share of 0 for each."""
        return _merged(self.looks.values()) | {f"share_{name}": 0.0 for name in self.looks}

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P), with the shares of the terms."""
        found = {name: look.evaluate(previous_pose, pose) for name, look in self.looks.items()}
        parts = {name: self.product.weights[name] * one.log_prob for name, one in found.items()}
        total: FloatArray = sum(parts.values(), np.zeros(len(pose)))
        told = {f"share_{name}": share for name, share in shares(parts, total).items()}
        notes = tuple(note for one in found.values() for note in one.notes)
        return Evaluation(total, notes, _merged(found.values()) | told)

    def remember(self, expected_pose: FloatArray) -> Product:
        """The product of what the terms remember; a term without a weight stays as it is."""
        remembering = {name: look.remember(expected_pose) for name, look in self.looks.items()}
        return replace(self.product, terms={**self.product.terms, **remembering})


def _merged(told: Iterable[Look | Evaluation]) -> dict[str, float]:
    return {name: value for one in told for name, value in one.diagnostics.items()}


def shares(parts: Mapping[str, FloatArray], total: FloatArray) -> dict[str, float]:
    """Cov(part, total) / Var(total) over the particles (N,) with a finite total; 0 for all where nothing varies."""
    finite = np.isfinite(total)
    apart = total[finite] - total[finite].mean() if finite.any() else np.zeros(0)
    spread = float((apart**2).sum())
    return {name: float((part[finite] * apart).sum()) / spread if spread > 0.0 else 0.0 for name, part in parts.items()}
