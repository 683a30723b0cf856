"""Freedom for every joint on top of a linear model of motion, so that unusual arms can be followed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.body.skeleton import parameters as named_parameters
from workbench.core.capabilities import ACTIVITY, BODY_PARTS, LIMB_COLUMNS, SEPARABLE, Traits
from workbench.core.discrepancy import Discrepancy, widening
from workbench.core.keys import records_arguments
from workbench.core.prior import Prior, PriorCapabilities
from workbench.priors.density import REFERENCE_RATE_HZ, Appended
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

SIGMA, AR_COEFFICIENT = 0.02, 0.9
"""Of a base that has not learned what it misses: 0.046 rad, 2.6°, in the long run."""


@records_arguments
class AROffsets(Appended):
    """The pose of another prior plus an offset δ for each of k joint angles, a first-order autoregression (AR):

        δ_t = a^n δ_t−1 + N(0, σ² (1 − a^2n) / (1 − a²)),  n = Δt · 30 Hz

    whose deviation in the long run is σ / √(1 − a²). Without the offsets a linear model of walking knows no other
    swing of the arms than its training data's. A state is the base prior's and then the k offsets,
    "<parameter>_offset".

    base: the other prior. sigma: rad per frame at 30 Hz; None: so that each offset's deviation in the long run is what
    the base's model misses of people left out (`motion.models.model_discrepancy`) times `core.discrepancy.widening`, or
    SIGMA where that is not learned. ar_coefficient: what is left of an offset after a frame; None: as learned, near 1 for most
    angles, since people differ by a bearing of their own; particles do better with less. parameters: names of joint
    angles or of body parts (`skeleton.PARTS`); None: all that the base moves but the root. Raises InputError for
    numbers out of range, and for parameters of the root."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the base offers, and columns for every joint of their own."""
        base: Traits = keys["base"]
        parts = {LIMB_COLUMNS, *({BODY_PARTS} if SEPARABLE in base.provides else ())}
        return replace(base, provides=(base.provides - {ACTIVITY}) | parts)

    def __init__(
        self,
        base: Prior,
        *,
        sigma: float | None = None,
        ar_coefficient: float | None = 0.9,
        parameters: Sequence[str] | None = None,
    ) -> None:
        if not ((sigma is None or 0.0 < sigma < np.inf) and (ar_coefficient is None or 0.0 <= ar_coefficient < 1.0)):
            raise InputError(
                f"prior: expected sigma > 0 and 0 <= ar_coefficient < 1, found {sigma} and {ar_coefficient}"
            )
        names = base.parameters if parameters is None else named_parameters("prior: parameters", parameters)
        moved = tuple(name for name in names if not name.startswith("root_"))
        if parameters is not None and len(moved) < len(names):
            raise InputError("prior: parameters must be joint angles, found some of the root")
        if unknown := [name for name in base.parameters if name not in POSE_NAMES]:
            raise InputError(
                f"prior: AROffsets supports only the person's 25 pose parameters; its base has {unknown[0]!r}"
            )
        super().__init__(base, "offsets", tuple(f"{name}_offset" for name in moved), "rad")
        self.sigma, self.ar_coefficients = _autoregressions(moved, base.capabilities.discrepancy, sigma, ar_coefficient)
        self.parameters = tuple(name for name in POSE_NAMES if name in {*base.parameters, *moved})
        self._angles = [POSE_NAMES.index(name) for name in moved]

    @property
    def capabilities(self) -> PriorCapabilities:
        """Pass on the base's: its density with the offsets', and its motion without them, which still finds a start.

        No smoothness, so that no fit takes the motion for all that this prior says.
        """
        return replace(self.base.capabilities, density=self.density(), smoothness=None)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D): the base's around a starting pose (P,), with offsets as they are in the long run.

        The offsets are not fitted to the pose: what the base misses of it, they have to find.
        """
        state = self.base.sample_initial(pose, n, rng)
        offsets = self.sigma / np.sqrt(1.0 - self.ar_coefficients**2) * rng.standard_normal((n, len(self._angles)))
        return np.concatenate([state, offsets], axis=1)

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.of_base(state)).copy()
        poses[:, self._angles] += state[:, self.own]
        return poses

    def transition(self, dt_s: float) -> tuple[FloatArray, float, FloatArray]:
        """Return what is left (k,) of offsets after `dt_s` seconds, zero, and the deviations (k,) of the noise
        since."""
        kept = self.ar_coefficients ** (dt_s * REFERENCE_RATE_HZ)
        return kept, 0.0, self.sigma * np.sqrt((1.0 - kept**2) / (1.0 - self.ar_coefficients**2))


def _autoregressions(
    names: Sequence[str], learned: Discrepancy | None, sigma: float | None, ar_coefficient: float | None
) -> tuple[FloatArray, FloatArray]:
    """σ and keep (k,) of the offsets of these joint angles: those given, else those learned, else SIGMA and KEEP."""
    wide = 1.0 if learned is None else widening(learned.n_people)
    deviations = {} if learned is None else dict(zip(learned.angles, wide * learned.deviations, strict=True))
    kept = {} if learned is None else dict(zip(learned.angles, learned.ar_coefficients, strict=True))
    keeps = np.array([kept.get(name, AR_COEFFICIENT) if ar_coefficient is None else ar_coefficient for name in names])
    sigmas = [
        deviations[name] * np.sqrt(1.0 - own**2) if sigma is None and name in deviations else sigma or SIGMA
        for name, own in zip(names, keeps, strict=True)
    ]
    return np.array(sigmas), keeps
