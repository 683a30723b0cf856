"""Several cues at once: the product of likelihoods, each tempered so that none silences the rest."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.likelihoods.likelihood import Likelihood, diagnostics, remember


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
    Raises InputError when there is no term, or the weights are not those of the terms or negative.
    """

    terms: Mapping[str, Likelihood]
    weights: Mapping[str, float]
    _shares: dict[str, float] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.terms:
            raise InputError("likelihood: a product needs at least one term")
        if set(self.weights) != set(self.terms):
            found = ", ".join(self.weights) or "none"
            raise InputError(f"likelihood: weights must be given for {', '.join(self.terms)}, found {found}")
        for name, weight in self.weights.items():
            if not 0.0 <= weight < np.inf:
                raise InputError(f"likelihood: the weight of {name} must be at least 0, found {weight}")

    @property
    def used(self) -> dict[str, Likelihood]:
        """The terms with a weight."""
        return {name: term for name, term in self.terms.items() if self.weights[name] > 0.0}

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P)."""
        parts = {
            name: self.weights[name] * term.log_prob(previous, frame, previous_pose, pose)
            for name, term in self.used.items()
        }
        total: FloatArray = sum(parts.values(), np.zeros(len(pose)))
        self._shares.clear()
        self._shares.update({f"share_{name}": share for name, share in shares(parts, total).items()})
        return total

    def diagnostics(self) -> dict[str, float]:
        """The shares of the last `log_prob`, and what the terms have to say."""
        own: dict[str, float] = {}
        for term in self.used.values():
            own |= diagnostics(term)
        return own | self._shares

    def begin(self, frame: Frame, pose: FloatArray) -> None:
        """Tell the terms that have a memory; see `Remembering`."""
        self._shares.clear()
        self._shares.update({f"share_{name}": 0.0 for name in self.used})
        for term in self.used.values():
            remember(term, frame, pose, first=True)

    def observe(self, frame: Frame, pose: FloatArray) -> None:
        """Tell the terms that have a memory; see `Remembering`."""
        for term in self.used.values():
            remember(term, frame, pose, first=False)

    def warnings(self) -> tuple[str, ...]:
        """Those of the terms."""
        return tuple(sentence for term in self.used.values() for sentence in term.warnings())


def shares(parts: Mapping[str, FloatArray], total: FloatArray) -> dict[str, float]:
    """Cov(part, total) / Var(total) over the particles (N,) with a finite total; 0 for all where nothing varies."""
    finite = np.isfinite(total)
    apart = total[finite] - total[finite].mean() if finite.any() else np.zeros(0)
    spread = float((apart**2).sum())
    return {name: float((part[finite] * apart).sum()) / spread if spread > 0.0 else 0.0 for name, part in parts.items()}
