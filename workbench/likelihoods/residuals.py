"""What least squares minimises in place of a product of likelihoods."""

from collections.abc import Mapping
from itertools import chain

import numpy as np

from workbench.core.observations import Observables, Observed
from workbench.core.residual import SQUARED, Loss, ResidualFunction, ResidualLikelihood, robust, scaled, stacked
from workbench.errors import InputError


def residual_terms(terms: Mapping[str, object], weights: Mapping[str, float]) -> dict[str, ResidualLikelihood]:
    """Pick the terms of a product that have a weight, by name; raises InputError where one has no residuals."""
    used = {name: term for name, term in terms.items() if weights[name] > 0.0}
    found = {name: term for name, term in used.items() if isinstance(term, ResidualLikelihood)}
    if lacking := [name for name in used if name not in found]:
        raise InputError(
            f"likelihood: least squares needs residuals of every term of a product, {lacking[0]} has none; give it "
            "the weight 0"
        )
    return found


def product_loss(terms: Mapping[str, ResidualLikelihood], weights: Mapping[str, float]) -> Loss:
    """Say the loss of stacked terms: that which all have, where all weights are 1; else each is made robust first."""
    return _common_loss(terms, weights) or SQUARED


def product_residual(
    terms: Mapping[str, ResidualLikelihood], weights: Mapping[str, float], observed: Observed
) -> ResidualFunction:
    """Stack the terms, in order, for the loss that `product_loss` says.

    Where they have no common one, half the square of each is its own loss times its weight.
    """
    plain = {name: term.residual(observed) for name, term in terms.items()}
    if _common_loss(terms, weights) is not None:
        return stacked(list(plain.values()))
    own = {name: robust(residual, terms[name].residual_loss) for name, residual in plain.items()}
    return stacked([scaled(residual, float(np.sqrt(weights[name]))) for name, residual in own.items()])


def joint_observables(terms: Mapping[str, ResidualLikelihood]) -> Observables:
    """Join all that some term looks at; deviations are those of the first term that has them."""
    every = [term.observables for term in terms.values()]
    points = next((one for one in every if one.sigma is not None), Observables())
    keypoints = [one for one in every if one.sigma_px is not None]
    cameras = None
    if keypoints and all(one.which is not None for one in keypoints):
        cameras = tuple(dict.fromkeys(chain.from_iterable(one.which or () for one in keypoints)))
    return Observables(points.sigma, points.kind, keypoints[0].sigma_px if keypoints else None, cameras)


def _common_loss(terms: Mapping[str, ResidualLikelihood], weights: Mapping[str, float]) -> Loss | None:
    losses = {term.residual_loss for term in terms.values()}
    return losses.pop() if len(losses) == 1 and all(weights[name] == 1.0 for name in terms) else None
