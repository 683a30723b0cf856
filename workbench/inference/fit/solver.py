"""Levenberg–Marquardt over sparse normal equations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.inference.fit.arrowhead import Arrowhead

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The Gauss–Newton model of a cost around a point: cost + gradient·δ + ½ δᵀ normal δ. gradient: (n,).

    trust: (n,) the diagonal of that part of `normal` which is an approximation; terms that are quadratic need no
    damping, which would only slow down what they tie together.
    """

    cost: float
    gradient: FloatArray
    normal: Arrowhead
    trust: FloatArray


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ended. x: (n,). quadratic: the model there. costs: at the start and after every accepted step,
    never rising. iterations: steps tried, each one evaluation."""

    x: FloatArray
    quadratic: Quadratic
    costs: tuple[float, ...]
    iterations: int


def minimise(
    expand: Callable[[FloatArray], Quadratic],
    x: FloatArray,
    *,
    max_iterations: int = 40,
    tolerance: float = 1e-4,
    progress: Callable[[float], None] = lambda cost: None,
) -> Minimum:
    """The minimum of a sum of squares near x (n,).

    expand: the cost and its quadratic model at a point; one call per iteration, as nearly all steps are accepted.
    The damping is relative to `Quadratic.trust` and follows the gain (Madsen, Nielsen & Tingleff 2004, algorithm 3.16).
    It ends when the model promises to lower the cost by less than `tolerance` of it. progress: called with the cost
    after every iteration.
    """
    here = expand(x)
    costs, damping, growth, iterations = [here.cost], FIRST_DAMPING, 2.0, 0
    while iterations < max_iterations and damping < LARGEST_DAMPING and here.gradient.any():
        scale = damping * np.maximum(here.trust, 1e-9 * here.trust.max())
        try:
            step = -here.normal.factor(scale).solve(here.gradient)
        except np.linalg.LinAlgError:  # not positive definite to rounding: more damping makes it so
            damping, growth = damping * growth, 2.0 * growth
            continue
        promised = 0.5 * float(step @ (scale * step - here.gradient))
        if promised <= tolerance * here.cost:
            break
        there = expand(x + step)
        iterations += 1
        gain = (here.cost - there.cost) / promised
        if gain > 0.0:
            x, here = x + step, there
            costs.append(here.cost)
            damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
        progress(here.cost)
    return Minimum(x, here, tuple(costs), iterations)
