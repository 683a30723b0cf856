"""The walking model of paper A, section 6.2: multivariate PCA of whole cycles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.kinematics import joint_jacobian
from workbench.body.skeleton import ERROR_JOINTS, N_ROOT, person_skeleton
from workbench.errors import InputError
from workbench.learning.cycles import ANGLES, CHANNEL_NAMES, ROOT_CHANNELS, Cycles, walking_cycles
from workbench.mocap.motion import Motion

SPEED_WEIGHT = 1.0 / 30.0  # as in the paper, speeds count in metres per frame at 30 Hz beside radians
SPEED_LEVER_S = 0.1  # how far a speed counts when channels are scaled by their effect: the way it makes in this time, s
LEAST_EFFECT_M = 0.005  # an angle that moves no joint (the twist of a straight arm) still counts this much, m per rad


@dataclass(frozen=True, eq=False)
class WalkingModel:
    """A* = Â + B̃ c (paper A, section 6.2), with d components over T phases of C channels.

    mean: (T, C). components: (d, T, C). scales: (d,), λ, the standard deviations of the coefficients over the
    training cycles. Channels are CHANNEL_NAMES, and ROOT_CHANNELS if learned, in m/s, rad and m. cycle_rate_hz: mean
    and standard deviation of the cycles per second. explained: fraction of the (scaled) variance the d components
    explain. n_cycles: how many cycles it was learned from.
    """

    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    cycle_rate_hz: tuple[float, float]
    explained: float
    n_cycles: int

    SHAPES: ClassVar[Mapping[str, str]] = {"mean": "TC", "components": "dTC", "scales": "d", "cycle_rate_hz": "2"}

    def flaw(self) -> str:
        """Say how many channels were expected where there are others."""
        known = len(CHANNEL_NAMES), len(CHANNEL_NAMES + ROOT_CHANNELS)
        found = self.mean.shape[1]
        return "" if found in known else f"{known[0]} or {known[1]} channels, found {found}"


def learn_walking(
    motions: Sequence[Motion], variance: float = 0.95, n_components: int | None = None, scaling: str = "none",
    n_phases: int = 64, root: bool = False,
) -> WalkingModel:  # fmt: skip
    """Learn the model from the walking cycles in the motions.

    n_components: the number d; None takes the fewest that explain more than the fraction `variance` of the variance.
    scaling: "none" as in the paper (speed in metres per frame at 30 Hz beside radians), or "joints", which weighs
    every channel by how far it moves the joints, so that twists that move nothing do not claim components. root: learn
    how the root sways, too, which the paper leaves to noise.
    Raises InputError when there are fewer than two cycles, or more components are asked for than there are.
    """
    if scaling not in ("none", "joints"):
        raise InputError(f"prior: scaling must be 'none' or 'joints', found {scaling!r}")
    if not 0.0 < variance < 1.0:
        raise InputError(f"prior: variance must lie between 0 and 1, found {variance}")
    cycles = walking_cycles(motions, n_phases, root)
    if len(cycles.curves) < 2:
        raise InputError(f"prior: expected at least two walking cycles in {len(motions)} motions, found fewer")
    weights = np.array([SPEED_WEIGHT] + [1.0] * (cycles.curves.shape[2] - 1))
    if scaling == "joints":
        weights = _joint_effects(cycles, motions)
    return _mpca(cycles, weights, variance, n_components)


def _mpca(cycles: Cycles, weights: FloatArray, variance: float, n_components: int | None) -> WalkingModel:
    m, n_phases, n_channels = cycles.curves.shape
    mean = cycles.curves.mean(axis=0)
    centred = ((cycles.curves - mean) * weights).reshape(m, -1)
    _, singular, rows = np.linalg.svd(centred, full_matrices=False)
    share = np.cumsum(singular**2) / np.sum(singular**2)
    most = min(m - 1, len(singular))
    d = n_components if n_components is not None else min(int(np.searchsorted(share, variance, side="right")) + 1, most)
    if not 1 <= d <= most:
        raise InputError(f"prior: {m} cycles allow 1 to {most} components, found {d}")
    rates = 1.0 / cycles.durations_s
    return WalkingModel(
        mean=mean, components=rows[:d].reshape(d, n_phases, n_channels) / weights,
        scales=singular[:d] / np.sqrt(m - 1), cycle_rate_hz=(float(rates.mean()), float(rates.std(ddof=1))),
        explained=float(share[d - 1]), n_cycles=m,
    )  # fmt: skip


def _joint_effects(cycles: Cycles, motions: Sequence[Motion]) -> FloatArray:
    """Root mean square way (C,), m, that one radian or metre of each moves the 14 joints, over the mean cycle."""
    skeleton = person_skeleton(motions[0].shape)
    poses = np.zeros((cycles.curves.shape[1], len(skeleton.dof_names)))
    poses[:, N_ROOT:] = cycles.curves.mean(axis=0)[:, ANGLES]
    measured = [skeleton.joint(name) for name in ERROR_JOINTS]
    moved = joint_jacobian(skeleton, poses)[:, measured]
    effects = np.maximum(np.sqrt((moved**2).sum(axis=2).mean(axis=(0, 1))), LEAST_EFFECT_M)
    n_root = cycles.curves.shape[2] - len(CHANNEL_NAMES)
    return np.concatenate([[SPEED_LEVER_S], effects[N_ROOT:], effects[N_ROOT - len(ROOT_CHANNELS) : N_ROOT][:n_root]])
