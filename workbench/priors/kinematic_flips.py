"""Jumps between the poses that one camera cannot tell apart (Sminchisescu & Triggs, Kinematic Jump Processes for
Monocular 3D Human Tracking, CVPR 2003)."""

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
from workbench.core.capabilities import LIMB_COLUMNS, ONE_CAMERA, Traits, needs_of_all, offering
from workbench.core.keys import records_arguments
from workbench.core.prior import Prior, PriorCapabilities, propose
from workbench.priors.density import REFERENCE_RATE_HZ
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

LIMBS = (
    *((side, "shoulder", "elbow", 1.0) for side in ("left", "right")),
    *((side, "hip", "knee", -1.0) for side in ("left", "right")),
)
"""Side, upper joint, lower joint, and whether the lower joint bends forwards (1) or backwards (−1)."""
_LOST = {capabilities.DENSITY, capabilities.ACTIVITY, capabilities.BODY_PARTS, capabilities.SEPARABLE}
"""Capabilities of the base that flips take away."""


@records_arguments
class KinematicFlips:
    """Another prior, under which forearms and calves may flip in depth:

        p(s_t | s_t−1) = (1 − π) p(s_t | s_t−1) + π / 4 Σ_l p(s_t | F_l s_t−1),  π = 1 − (1 − probability)^(Δt · 30 Hz)

    F_l mirrors limb l in the plane through its upper end that faces the camera, by a new twist above and a new bend, so
    that its lower end is seen about where it was. Where the body's limits forbid that, F_l changes nothing. Left out:
    whole arms and legs, whose flip also turns the next limb; velocities, which stay. `sample_transition` draws exactly.
    `propose` lets a share of the particles flip and corrects their weights by π / share, those of the others by (1 − π)
    / (1 − share).

    base: a prior with columns of its own for the joints' angles, such as `Smooth` (without limits on the limb's
    parameters that are narrower than the body's), or for offsets to them, such as `AROffsets`. camera: gives the camera,
    when first asked. Raises InputError for a base without such columns and for numbers out of range."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the base offers but its density, and one camera that limbs may flip before."""
        base: Traits = keys["base"]
        lacks = "" if LIMB_COLUMNS in base.provides else f"flips need {LIMB_COLUMNS} of their base"
        needs = needs_of_all({"base": base, "flips": offering(dataset=ONE_CAMERA)})
        return Traits(base.provides - _LOST, needs, base.missing or lacks)

    def __init__(
        self, base: Prior, camera: Callable[[], Camera], *, probability: float = 0.01, proposal_fraction: float = 0.1
    ) -> None:
        if not 0.0 < probability <= proposal_fraction < 1.0:
            raise InputError(
                f"prior: expected 0 < probability <= proposal_fraction < 1, found {probability} and {proposal_fraction}"
            )
        self.base, self.probability, self.proposal_fraction = base, probability, proposal_fraction
        self.space, self.parameters = base.space, base.parameters
        self.limbs = [limb for limb in LIMBS if all(self._column(name) is not None for name in angles(limb))]
        if not self.limbs:
            columns = "columns of its own for the twist and the bend of a limb, as smooth and ar_offsets have"
            raise InputError(f"prior: flips need a base with {columns}; it has {', '.join(self.space.slices)}")
        self._camera = camera
        self._skeleton = person_skeleton(from_height(1.75))

    @property
    def capabilities(self) -> PriorCapabilities:
        """Pass on those of the base, without its density: which flip led to a state is not known."""
        return replace(self.base.capabilities, density=None)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), as the base has them."""
        return self.base.sample_initial(pose, n, rng)

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return self.base.sample_transition(self._flipped(state, self._pi(dt_s), rng)[0], dt_s, rng)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), a share of them from flipped states, and the log weights (N,) that correct for it."""
        pi = self._pi(dt_s)
        flipped, limb = self._flipped(state, self.proposal_fraction, rng)
        moved, correction = propose(self.base, flipped, dt_s, rng)
        odds = np.log([(1.0 - pi) / (1.0 - self.proposal_fraction), pi / self.proposal_fraction])
        return moved, correction + odds[(limb > 0).astype(np.int64)]

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        return self.base.pose(state)

    def _pi(self, dt_s: float) -> float:
        return float(1.0 - (1.0 - self.probability) ** (dt_s * REFERENCE_RATE_HZ))

    def _flipped(
        self, state: FloatArray, proposal_fraction: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """The states (N, D), a share of them flipped, and which limb (N,) of each was: 0 for none."""
        chances = np.array([1.0 - proposal_fraction, *[proposal_fraction / len(self.limbs)] * len(self.limbs)])
        limb = stratified_choice(chances, len(state), rng)
        state = state.copy()
        for k, which in enumerate(self.limbs, start=1):
            if (own := limb == k).any():
                poses = self.base.pose(np.ascontiguousarray(state[own]))
                change = self.flip(poses, which) - poses
                for name in angles(which):
                    state[own, self._column(name)] += change[:, POSE_NAMES.index(name)]
        return state, limb

    def flip(self, poses: FloatArray, limb: tuple[str, str, str, float]) -> FloatArray:
        """The poses (N, P) with one of LIMBS mirrored in depth; unchanged where the body's limits forbid it.

        Below the upper joint's twist φ, a limb bent by e points to Rz(φ) (± sin e, 0, −cos e) in that joint's frame,
        which a direction gives back as e = arccos(−z) and φ = arctan(± y / ± x).
        """
        side, upper, lower, forwards = limb
        turn, bend = (POSE_NAMES.index(name) for name in angles(limb))
        outwards = -1.0 if side == "left" else 1.0  # twists are positive inwards on both sides
        frames = forward(self._skeleton, poses)
        low, high = (self._skeleton.joint(f"{side}_{joint}") for joint in (lower, upper))
        ray = frames.positions[:, low] - self._camera().position
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        along = -frames.rotations[:, low, :, 2]
        mirrored = along - 2.0 * (along * ray).sum(axis=1, keepdims=True) * ray
        seen = np.einsum("nji,nj->ni", frames.rotations[:, high], mirrored)
        bent = np.arccos(np.clip(-seen[:, 2], -1.0, 1.0))
        more = np.arctan2(forwards * seen[:, 1], forwards * seen[:, 0])
        flipped = poses.copy()
        flipped[:, turn] = wrapped(poses[:, turn] + outwards * more)
        flipped[:, bend] = bent
        limits = self._skeleton.limits[[turn, bend]]
        allowed = ((flipped[:, [turn, bend]] >= limits[:, 0]) & (flipped[:, [turn, bend]] <= limits[:, 1])).all(axis=1)
        allowed &= poses[:, bend] >= 0.0  # so that flipping twice is not flipping
        return np.where(allowed[:, None], flipped, poses)

    def _column(self, name: str) -> int | None:
        names = self.space.names if name in self.parameters else ()
        return next((names.index(column) for column in (f"{name}_offset", name) if column in names), None)


def angles(limb: tuple[str, str, str, float]) -> tuple[str, str]:
    """The parameters that turn a limb over: the twist above it and its own bend."""
    side, upper, lower, _ = limb
    return f"{side}_{upper}_twist", f"{side}_{lower}_flexion"


def stratified_choice(probabilities: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """Draw components (n,) with probabilities (K,), each in a number within one of n times its probability.

    The n positions are equidistant with one random offset, shuffled, so that every single one is uniform on [0, 1).
    """
    positions = (rng.permutation(n) + rng.random()) / n
    last = int(np.flatnonzero(probabilities)[-1])  # rounding may leave the last edge short of one
    return np.minimum(np.searchsorted(np.cumsum(probabilities), positions, side="right"), last)
