"""Models of walking: paper A's PCA of cycles cut at gait events (section 6.2), and paper B's functional PCA."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from workbench.body.kinematics import joint_jacobian
from workbench.body.skeleton import ERROR_JOINTS, N_ROOT, POSE_NAMES, person_skeleton
from workbench.core.discrepancy import Discrepancy
from workbench.motion.models.cycle_alignment import CycleAlignment, align, motion_period
from workbench.motion.models.functional_pca import Slices, cut, fpca_shrunk
from workbench.motion.pose_sequence import LONGEST_S, SHORTEST_S, Motion, gait_events
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

CHANNEL_NAMES = ("torso_speed", *POSE_NAMES[N_ROOT:])
"""One cycle's content (paper A, section 6.2): the torso's speed, m/s, and the 19 relative joint angles, rad."""
ANGLES = slice(1, len(CHANNEL_NAMES))  # which channels are the joint angles
ROOT_CHANNELS = ("root_aside", "root_up", "root_heading", "root_pitch", "root_roll")
"""Further content: how the root sways about its even way, m, and turns about its even direction, rad."""
SPEED_WEIGHT = 1.0 / 30.0  # as in the paper, speeds count in metres per frame at 30 Hz beside radians
SPEED_LEVER_S = 0.1  # how far a speed counts when channels are scaled by their effect: the way it makes in this time, s
LEAST_OBSERVED = 0.5  # of a cycle's samples, for paper B's model
LEAST_EFFECT_M = 0.005  # an angle that moves no joint (the twist of a straight arm) still counts this much, m per rad
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Cycles:
    """m cycles of C channels at T phases 0, 1/T, … (one cycle is 1).

    curves: (m, T, C), channels named CHANNEL_NAMES, and ROOT_CHANNELS where the root's were asked for. durations_s:
    (m,). sources: the motion each one was cut from.
    """

    curves: FloatArray
    durations_s: FloatArray
    sources: tuple[str, ...]


def walking_cycles(motions: Sequence[Motion], n_phases: int = 64, include_root: bool = False) -> Cycles:
    """Cut every whole walking cycle in the motions, resampled to `n_phases` phases (paper A, section 6.2).

    Phase 0 is where the left thigh is furthest ahead of the right. A recorded cycle does not quite close; half the
    gap is taken from each end, linearly in between, so that the curves are periodic (a deviation: the paper does not
    say). Motions without a whole cycle add nothing. The result may be empty. include_root: with ROOT_CHANNELS.
    """
    curves, durations, sources, phases = [], [], [], np.arange(n_phases) / n_phases
    for motion in motions:
        events = gait_events(motion)
        if len(events) < 2:
            continue
        channels = scipy.interpolate.CubicSpline(np.arange(len(motion)), _motion_channels(motion))
        for first, last in pairwise(events):
            duration = (last - first) / motion.rate_hz
            if SHORTEST_S <= duration <= LONGEST_S:
                gap = channels(last) - channels(first)
                curve = channels(first + (last - first) * phases) - (phases - 0.5)[:, None] * gap
                curves.append(np.hstack([curve, _root_sway(motion, first, last, n_phases)]) if include_root else curve)
                durations.append(duration)
                sources.append(motion.name)
    shape = (len(curves), n_phases, len(CHANNEL_NAMES) + len(ROOT_CHANNELS) * include_root)
    return Cycles(np.array(curves).reshape(shape), np.array(durations), tuple(sources))


def _motion_channels(motion: Motion) -> FloatArray:
    """Return the channels (F, C) of a motion: speed over the ground along the heading, m/s, and the joint angles, rad.

    The paper takes the speed's absolute value; the component along the heading does not count sway as progress.
    """
    ground = motion.velocities[:, :2]
    heading = motion.poses[:, POSE_NAMES.index("root_heading")]
    speed = ground[:, 0] * np.cos(heading) + ground[:, 1] * np.sin(heading)
    return np.column_stack([speed, motion.poses[:, N_ROOT:]])


def _root_sway(motion: Motion, first: float, last: float, n_phases: int) -> FloatArray:
    """Return how the root moves about its even way in one cycle, ROOT_CHANNELS (T, 5), with means of zero.

    The even way turns and rises evenly, from what the root does in the mean over the cycle; aside is the integral of
    the velocity across it. What the root does ahead of it is in the torso's speed.
    """
    frames = first + (last - first) * np.arange(n_phases + 1) / n_phases
    root = scipy.interpolate.CubicSpline(np.arange(len(motion)), motion.poses[:, :N_ROOT])(frames)
    ground = scipy.interpolate.CubicSpline(np.arange(len(motion)), motion.velocities[:, :2])(frames)
    even = np.linspace(-0.5, 0.5, n_phases + 1)[:, None] * (root[-1] - root[0])
    swayed = root - even
    swayed -= swayed[:-1].mean(axis=0)
    heading = root[:, 3] - swayed[:, 3]
    across = -ground[:, 0] * np.sin(heading) + ground[:, 1] * np.cos(heading)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (across[1:] + across[:-1]))]) * (frames[1] - frames[0])
    way = way / motion.rate_hz - np.linspace(0.0, 1.0, n_phases + 1) * way[-1] / motion.rate_hz
    aside = way - way[:-1].mean()
    return np.column_stack([aside, swayed[:, 2:]])[:-1]


@dataclass(frozen=True, eq=False)
class WalkingModel:
    """A* = Â + B̃ c (paper A, section 6.2), with d components over T phases of C channels.

    mean: (T, C). components: (d, T, C). scales: (d,), λ, the standard deviations of the coefficients over the
    training cycles. Channels are CHANNEL_NAMES, and ROOT_CHANNELS if learned, in m/s, rad and m. cycle_rate_hz: mean
    and standard deviation of the cycles per second. explained: fraction of the (scaled) variance the d components
    explain. n_cycles: how many cycles it was learned from. discrepancy: what it misses of others, where that is known.
    """

    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    cycle_rate_hz: tuple[float, float]
    explained: float
    n_cycles: int
    discrepancy: Discrepancy | None = None


def learn_walking(
    motions: Sequence[Motion], *, variance: float, n_components: int | None, scaling: str, n_phases: int = 64,
    include_root: bool = False,
) -> WalkingModel:  # fmt: skip
    """Learn the model from the walking cycles in the motions.

    Parameters
    ----------
    motions : the walks
    variance : where n_components is None, the fewest components that explain more than this fraction of the variance
    n_components : their number d
    scaling : "none" as in the paper (speed in metres per frame at 30 Hz, angles in rad), or "joints", which weighs
        every channel by how far it moves the joints, so that twists that move nothing do not claim components
    n_phases : T
    include_root : learn how the root sways, too, which the paper leaves to noise

    Raises
    ------
    InputError : fewer than two cycles, or more components than they allow
    """
    if scaling not in ("none", "joints"):
        raise InputError(f"prior: scaling must be 'none' or 'joints', found {scaling!r}")
    if not 0.0 < variance < 1.0:
        raise InputError(f"prior: variance must lie between 0 and 1, found {variance}")
    cycles = walking_cycles(motions, n_phases, include_root)
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
    """Return the root mean square way (C,), m, that one radian or metre moves the 14 joints, over the mean cycle."""
    skeleton = person_skeleton(motions[0].shape)
    poses = np.zeros((cycles.curves.shape[1], len(skeleton.dof_names)))
    poses[:, N_ROOT:] = cycles.curves.mean(axis=0)[:, ANGLES]
    measured = [skeleton.joint(name) for name in ERROR_JOINTS]
    moved = joint_jacobian(skeleton, poses)[:, measured]
    effects = np.maximum(np.sqrt((moved**2).sum(axis=2).mean(axis=(0, 1))), LEAST_EFFECT_M)
    n_root = cycles.curves.shape[2] - len(CHANNEL_NAMES)
    return np.concatenate([[SPEED_LEVER_S], effects[N_ROOT:], effects[N_ROOT - len(ROOT_CHANNELS) : N_ROOT][:n_root]])


def learn_cyclic(motions: Sequence[Motion], n_components: int = 5, n_phases: int = 64) -> WalkingModel:
    """Learn the walking model of motions with q components (paper B, section 2); missing angles are NaN in their poses.

    A missing position or heading makes the torso's speed missing. Motions in which no period is found are left out,
    with a warning. Raises InputError when fewer than two are left, or they hold too few cycles.

    Deviation: slices seen by less than half, the ends of the sequences, are left out, because what is imputed in
    them pulls the coefficients' standard deviations towards zero.
    """
    sequences, periods, rates = [], [], []
    for motion in motions:
        channels = _motion_channels(motion)
        channels[:, 0] *= SPEED_WEIGHT
        try:
            period = motion_period(motion, channels[:, 1:])
        except InputError as error:
            log.warning("%s left out of the training set: %s", motion.name, error)
            continue
        sequences.append(channels)
        periods.append(period)
        rates.append(motion.rate_hz / period)
    if len(sequences) < 2:
        raise InputError(f"prior: expected two motions with a period or more, found {len(sequences)} of {len(motions)}")
    alignment = align([channels[:, 1:] for channels in sequences], periods)
    slices = cut(sequences, _from_left_thigh_ahead(alignment), n_phases)
    kept = slices.observed.mean(axis=(1, 2)) >= LEAST_OBSERVED
    slices = Slices(slices.values[kept], slices.observed[kept], slices.sequence[kept], slices.cycle[kept])
    pca = fpca_shrunk(slices, n_components)
    weights = np.array([SPEED_WEIGHT] + [1.0] * (len(CHANNEL_NAMES) - 1))
    return WalkingModel(
        mean=pca.mean / weights, components=pca.components / weights, scales=pca.scales,
        cycle_rate_hz=(float(np.mean(rates)), float(np.std(rates, ddof=1))), explained=pca.explained,
        n_cycles=len(slices.values),
    )  # fmt: skip


def _from_left_thigh_ahead(alignment: CycleAlignment) -> CycleAlignment:
    """Turn the alignment of joint angles with phase 0 where the left thigh is furthest ahead of the right."""
    first = len(POSE_NAMES) - alignment.reference.shape[1]
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") - first for side in ("left", "right"))
    ahead = int(np.argmax(alignment.reference[:, left] - alignment.reference[:, right]))
    offsets = (alignment.offsets - ahead / len(alignment.reference)) % 1.0
    return replace(alignment, offsets=offsets, reference=np.roll(alignment.reference, -ahead, axis=0))
