"""Autoregressive offsets of joint angles on top of another prior, for motion outside its model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.body.skeleton import parameters as named_parameters
from workbench.core.capabilities import ACTIVITY, BODY_PARTS, SEPARABLE, Traits
from workbench.core.discrepancy import Discrepancy, small_sample_inflation
from workbench.core.prior import Prior, PriorCapabilities
from workbench.priors.density import REFERENCE_RATE_HZ, AppendedColumns
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

SIGMA, AR_COEFFICIENT = 0.02, 0.9
"""For a base without a learned discrepancy: a stationary standard deviation of 0.046 rad, 2.6°."""


class AROffsets(AppendedColumns):
    """The pose of another prior plus an offset δ of each of k joint angles, a first-order autoregression (AR):

        δ_t = a^n δ_t−1 + N(0, σ² (1 − a^2n) / (1 − a²)),  n = Δt · 30 Hz

    The stationary standard deviation is σ / √(1 − a²). Without offsets, a linear model of walking covers only the arm
    swing of its training data. A state is the base prior's followed by the k offsets, "<parameter>_offset".

    Parameters
    ----------
    base : the other prior.
    sigma : σ, rad per frame at 30 Hz. None: the stationary standard deviation of each offset is the base's discrepancy
        on held-out subjects (`motion.models.model_discrepancy`) times `core.discrepancy.small_sample_inflation`; SIGMA
        where no discrepancy is learned.
    ar_coefficient : a, the fraction of an offset that remains after one frame at 30 Hz. None: as learned, near 1 for
        most angles, since subjects differ by a constant posture; particle filters perform better with less.
    parameters : names of joint angles or of body parts (`skeleton.PARTS`). None: all joint angles that the base moves.

    Raises
    ------
    InputError : values out of range, or parameters of the root.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the base's capabilities, and independent columns for every joint if the base's are independent."""
        base: Traits = keys["base"]
        parts = {BODY_PARTS} if SEPARABLE in base.provides else set()
        return replace(base, provides=(base.provides - {ACTIVITY}) | parts)

    def __init__(
        self, base: Prior, *, sigma: float | None = None, ar_coefficient: float | None = 0.9,
        parameters: Sequence[str] | None = None,
    ) -> None:  # fmt: skip
        if not ((sigma is None or 0.0 < sigma < np.inf) and (ar_coefficient is None or 0.0 <= ar_coefficient < 1.0)):
            values = f"{sigma} and {ar_coefficient}"
            raise InputError(f"prior: expected sigma > 0 and 0 <= ar_coefficient < 1, found {values}")
        names = base.parameters if parameters is None else named_parameters("prior: parameters", parameters)
        angles = tuple(name for name in names if not name.startswith("root_"))
        if parameters is not None and len(angles) < len(names):
            raise InputError("prior: parameters must be joint angles, found some of the root")
        if unknown := [name for name in base.parameters if name not in POSE_NAMES]:
            raise InputError(f"prior: AROffsets needs a base with the 25 pose parameters, found {unknown[0]!r}")
        super().__init__(base, "offsets", tuple(f"{name}_offset" for name in angles), "rad")
        discrepancy = base.capabilities.discrepancy
        self.sigma, self.ar_coefficients = _noise_and_coefficients(angles, discrepancy, sigma, ar_coefficient)
        self.parameters = tuple(name for name in POSE_NAMES if name in {*base.parameters, *angles})
        self._angles = [POSE_NAMES.index(name) for name in angles]

    @property
    def capabilities(self) -> PriorCapabilities:
        """The base's density times the offsets', and the base's motion model, for the initial pose.

        There is no smoothness, since the motion model alone does not describe this prior and must not be fitted.
        """
        return replace(self.base.capabilities, density=self.density(), smoothness=None)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D): the base's around an initial pose (P,), with stationary offsets.

        The offsets are not fitted to the pose; the filter has to find the base's residual.
        """
        state = self.base.sample_initial(pose, n, rng)
        stationary_std = self.sigma / np.sqrt(1.0 - self.ar_coefficients**2)
        offsets = stationary_std * rng.standard_normal((n, len(self._angles)))
        return np.concatenate([state, offsets], axis=1)

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.base_state(state)).copy()
        poses[:, self._angles] += state[:, self.appended]
        return poses

    def transition(self, dt_s: float) -> tuple[FloatArray, float, FloatArray]:
        """Return the AR coefficients (k,) over `dt_s` seconds, zero, and the noise standard deviations (k,)."""
        coefficients = self.ar_coefficients ** (dt_s * REFERENCE_RATE_HZ)
        return coefficients, 0.0, self.sigma * np.sqrt((1.0 - coefficients**2) / (1.0 - self.ar_coefficients**2))


def _noise_and_coefficients(
    names: Sequence[str], learned: Discrepancy | None, sigma: float | None, ar_coefficient: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return σ and a (k,) of the offsets of these joint angles: as set, else as learned, else SIGMA, AR_COEFFICIENT."""
    stds: dict[str, float] = {}
    learned_coefficients: dict[str, float] = {}
    if learned is not None:
        inflation = small_sample_inflation(learned.n_subjects)
        stds = dict(zip(learned.angles, inflation * learned.std, strict=True))
        learned_coefficients = dict(zip(learned.angles, learned.ar_coefficients, strict=True))
    coefficients = np.array([
        learned_coefficients.get(name, AR_COEFFICIENT) if ar_coefficient is None else ar_coefficient for name in names
    ])  # fmt: skip
    sigmas = [
        stds[name] * np.sqrt(1.0 - a**2) if sigma is None and name in stds else sigma or SIGMA
        for name, a in zip(names, coefficients, strict=True)
    ]
    return np.array(sigmas), coefficients
