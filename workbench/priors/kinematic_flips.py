"""Kinematic flips: depth-reversed limbs with the same projection in one camera.

References
----------
Sminchisescu & Triggs, Kinematic Jump Processes for Monocular 3D Human Tracking, CVPR 2003.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.angles import wrapped
from workbench.body.camera import Camera
from workbench.body.kinematics import forward
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core import capabilities
from workbench.core.capabilities import LIMB_COLUMNS, ONE_CAMERA, Traits, combined_requirements, component_traits
from workbench.core.prior import Prior, PriorCapabilities, propose
from workbench.priors.density import REFERENCE_RATE_HZ
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

LIMBS = (
    *((side, "shoulder", "elbow", 1.0) for side in ("left", "right")),
    *((side, "hip", "knee", -1.0) for side in ("left", "right")),
)
"""Side, upper joint, lower joint, and the bending direction of the lower joint: forwards (1) or backwards (−1)."""
_REMOVED = {capabilities.DENSITY, capabilities.ACTIVITY, capabilities.BODY_PARTS, capabilities.SEPARABLE}
"""Capabilities of the base that flips remove."""


class KinematicFlips:
    """Another prior, with depth flips of forearms and calves:

        p(s_t | s_t−1) = (1 − π) p(s_t | s_t−1) + π / 4 Σ_l p(s_t | F_l s_t−1),  π = 1 − (1 − probability)^(Δt · 30 Hz)

    F_l mirrors limb l in the plane through its upper end perpendicular to the viewing ray, by a new twist above it and
    a new flexion, so that the projection of its lower end is nearly unchanged. Where the joint limits forbid this, F_l
    is the identity. Not included: flips of whole arms and legs, which also rotate the next limb. Velocities are
    unchanged. `sample_transition` samples exactly. `propose` flips the fraction f = proposal_fraction of the particles
    and weights them by π / f, and the others by (1 − π) / (1 − f).

    Parameters
    ----------
    base : a prior with columns for joint angles, such as `Smooth` (with limits on the limb's parameters that are no
        narrower than the skeleton's), or for offsets to them, such as `AROffsets`.
    camera : returns the camera; called at the first use.
    probability : of a flip, per frame at 30 Hz.
    proposal_fraction : f, at least `probability`.

    Raises
    ------
    InputError : a base without such columns, or values out of range.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the base's capabilities without its density; require a single camera."""
        base: Traits = keys["base"]
        missing = "" if LIMB_COLUMNS in base.provides else f"flips need a base with {LIMB_COLUMNS}"
        needs = combined_requirements({"base": base, "flips": component_traits(dataset=ONE_CAMERA)})
        return Traits(base.provides - _REMOVED, needs, base.missing or missing)

    def __init__(
        self, base: Prior, camera: Callable[[], Camera], *, probability: float = 0.01, proposal_fraction: float = 0.1
    ) -> None:
        if not 0.0 < probability <= proposal_fraction < 1.0:
            values = f"{probability} and {proposal_fraction}"
            raise InputError(f"prior: expected 0 < probability <= proposal_fraction < 1, found {values}")
        self.base, self.probability, self.proposal_fraction = base, probability, proposal_fraction
        self.space, self.parameters = base.space, base.parameters
        self.limbs = [limb for limb in LIMBS if all(self._column(name) is not None for name in angles(limb))]
        if not self.limbs:
            columns = "columns for the twist and flexion of a limb, as smooth and ar_offsets have"
            raise InputError(f"prior: flips need a base with {columns}; it has {', '.join(self.space.slices)}")
        self._camera = camera
        self._skeleton = person_skeleton(from_height(1.75))

    @property
    def capabilities(self) -> PriorCapabilities:
        """The base's, without its density, since the flip that led to a state is unknown."""
        return replace(self.base.capabilities, density=None)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) of the base around an initial pose (P,)."""
        return self.base.sample_initial(pose, n, rng)

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later."""
        return self.base.sample_transition(self._flipped(state, self._pi(dt_s), rng)[0], dt_s, rng)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample states (N, D), a fraction of them flipped; return them with their log importance weights (N,)."""
        pi = self._pi(dt_s)
        flipped, limb = self._flipped(state, self.proposal_fraction, rng)
        moved, log_weights = propose(self.base, flipped, dt_s, rng)
        log_ratios = np.log([(1.0 - pi) / (1.0 - self.proposal_fraction), pi / self.proposal_fraction])
        return moved, log_weights + log_ratios[(limb > 0).astype(np.int64)]

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        return self.base.pose(state)

    def _pi(self, dt_s: float) -> float:
        return float(1.0 - (1.0 - self.probability) ** (dt_s * REFERENCE_RATE_HZ))

    def _flipped(self, state: FloatArray, fraction: float, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Return the states (N, D), a fraction of them flipped, and the number (N,) of the flipped limb, 0 for none."""
        probabilities = np.array([1.0 - fraction, *[fraction / len(self.limbs)] * len(self.limbs)])
        limb = stratified_choice(probabilities, len(state), rng)
        state = state.copy()
        for k, flipped_limb in enumerate(self.limbs, start=1):
            if (rows := limb == k).any():
                poses = self.base.pose(np.ascontiguousarray(state[rows]))
                change = self.flip(poses, flipped_limb) - poses
                for name in angles(flipped_limb):
                    state[rows, self._column(name)] += change[:, POSE_NAMES.index(name)]
        return state, limb

    def flip(self, poses: FloatArray, limb: tuple[str, str, str, float]) -> FloatArray:
        """Return the poses (N, P) with one of LIMBS mirrored in depth, where the joint limits allow it.

        For a twist φ of the upper joint and a flexion e, the limb has the direction Rz(φ) (± sin e, 0, −cos e) in the
        frame above the twist; inversely e = arccos(−z) and φ = arctan(± y / ± x).
        """
        side, upper, lower, forwards = limb
        twist, flexion = (POSE_NAMES.index(name) for name in angles(limb))
        outwards = -1.0 if side == "left" else 1.0  # twists are positive inwards on both sides
        frames = forward(self._skeleton, poses)
        low, high = (self._skeleton.joint(f"{side}_{joint}") for joint in (lower, upper))
        ray = frames.positions[:, low] - self._camera().position
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        along = -frames.rotations[:, low, :, 2]
        mirrored = along - 2.0 * (along * ray).sum(axis=1, keepdims=True) * ray
        local = np.einsum("nji,nj->ni", frames.rotations[:, high], mirrored)
        new_flexion = np.arccos(np.clip(-local[:, 2], -1.0, 1.0))
        twist_change = np.arctan2(forwards * local[:, 1], forwards * local[:, 0])
        flipped = poses.copy()
        flipped[:, twist] = wrapped(poses[:, twist] + outwards * twist_change)
        flipped[:, flexion] = new_flexion
        limits = self._skeleton.limits[[twist, flexion]]
        allowed = ((flipped[:, [twist, flexion]] >= limits[:, 0]) & (flipped[:, [twist, flexion]] <= limits[:, 1])).all(
            axis=1
        )
        allowed &= poses[:, flexion] >= 0.0  # so that flipping twice is the identity
        return np.where(allowed[:, None], flipped, poses)

    def _column(self, name: str) -> int | None:
        names = self.space.names if name in self.parameters else ()
        return next((names.index(column) for column in (f"{name}_offset", name) if column in names), None)


def angles(limb: tuple[str, str, str, float]) -> tuple[str, str]:
    """Return the names of the parameters that a flip changes: the twist above the limb and its flexion."""
    side, upper, lower, _ = limb
    return f"{side}_{upper}_twist", f"{side}_{lower}_flexion"


def stratified_choice(probabilities: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """Sample n components with probabilities (K,) by systematic sampling; counts are within one of n times these.

    The n positions are equidistant with one random offset and are permuted, so that each is uniform on [0, 1).
    """
    positions = (rng.permutation(n) + rng.random()) / n
    last = int(np.flatnonzero(probabilities)[-1])  # rounding may leave the last edge short of one
    return np.minimum(np.searchsorted(np.cumsum(probabilities), positions, side="right"), last)
