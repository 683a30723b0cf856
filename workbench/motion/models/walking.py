"""Models of walking: paper A's PCA of cycles between gait events (section 6.2), and paper B's functional PCA."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from workbench.body.kinematics import joint_jacobian
from workbench.body.skeleton import ERROR_JOINTS, N_ROOT, POSE_NAMES, person_skeleton
from workbench.core.discrepancy import Discrepancy
from workbench.motion.models.activities import min_components
from workbench.motion.models.cycle_alignment import CycleAlignment, align, motion_period
from workbench.motion.models.functional_pca import Slices, cut, fpca_paper, fpca_shrunk
from workbench.motion.pose_sequence import MAX_CYCLE_S, MIN_CYCLE_S, Motion, gait_events
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

CHANNEL_NAMES = ("torso_speed", *POSE_NAMES[N_ROOT:])
"""Channels of a cycle (paper A, section 6.2): the torso's speed, m/s, and the 19 relative joint angles, rad."""
ANGLES = slice(1, len(CHANNEL_NAMES))  # which channels are the joint angles
ROOT_CHANNELS = ("root_aside", "root_up", "root_heading", "root_pitch", "root_roll")
"""Further channels: the root's sway about its uniform path, m, and about its mean orientation, rad."""
SPEED_WEIGHT = 1.0 / 30.0  # as in the paper, speeds are in metres per frame at 30 Hz, angles in radians
SPEED_LEVER_S = 0.1  # time, s, over which a speed counts as a displacement when channels are scaled by their effect
DRAWN_PEOPLE, DRAWN_CYCLES = 4, (8, 13)  # of `component_counts`
MIN_OBSERVED = 0.5  # fraction of a slice's samples, for paper B's model
MIN_EFFECT_M = 0.005  # lower bound for angles that move no joint (the twist of a straight arm), m per rad
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Cycles:
    """m cycles of C channels at T phases 0, 1/T, … (one cycle is 1).

    curves : (m, T, C), channels CHANNEL_NAMES and, if included, ROOT_CHANNELS. durations_s : (m,). sources : the motion
    of each cycle.
    """

    curves: FloatArray
    durations_s: FloatArray
    sources: tuple[str, ...]


def walking_cycles(
    motions: Sequence[Motion], n_phases: int = 64, include_root: bool = False, torso_speed: str = "forward"
) -> Cycles:
    """Return every whole walking cycle of the motions, resampled to `n_phases` phases (paper A, section 6.2).

    Phase 0 is where the left thigh is furthest ahead of the right. A recorded cycle does not quite close; the gap is
    distributed linearly, half of it at each end, so that the curves are periodic (a deviation: the paper does not
    specify this). The result may be empty. include_root : with ROOT_CHANNELS. torso_speed : see
    `learn_walking`.
    """
    curves, durations, sources, phases = [], [], [], np.arange(n_phases) / n_phases
    for motion in motions:
        events = gait_events(motion)
        if len(events) < 2:
            continue
        channels = scipy.interpolate.CubicSpline(np.arange(len(motion)), _motion_channels(motion, torso_speed))
        for first, last in pairwise(events):
            duration = (last - first) / motion.rate_hz
            if MIN_CYCLE_S <= duration <= MAX_CYCLE_S:
                gap = channels(last) - channels(first)
                curve = channels(first + (last - first) * phases) - (phases - 0.5)[:, None] * gap
                curves.append(np.hstack([curve, _root_sway(motion, first, last, n_phases)]) if include_root else curve)
                durations.append(duration)
                sources.append(motion.name)
    shape = (len(curves), n_phases, len(CHANNEL_NAMES) + len(ROOT_CHANNELS) * include_root)
    return Cycles(np.array(curves).reshape(shape), np.array(durations), tuple(sources))


def _motion_channels(motion: Motion, torso_speed: str = "forward") -> FloatArray:
    """Return the channels (F, C) of a motion: the torso's speed, m/s, see `learn_walking`, and the joint angles,
    rad."""
    velocity = motion.velocities[:, :3]
    heading = motion.poses[:, POSE_NAMES.index("root_heading")]
    speed = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    if torso_speed == "norm":
        speed = np.linalg.norm(velocity, axis=1)
    return np.column_stack([speed, motion.poses[:, N_ROOT:]])


def _root_sway(motion: Motion, first: float, last: float, n_phases: int) -> FloatArray:
    """Return the root's sway about its uniform path in one cycle, ROOT_CHANNELS (T, 5), with means of zero.

    The uniform path has the cycle's mean rates of turning and rising; the lateral sway is the integral of the velocity
    across it. The motion along the path is in the torso's speed.
    """
    frames = first + (last - first) * np.arange(n_phases + 1) / n_phases
    root = scipy.interpolate.CubicSpline(np.arange(len(motion)), motion.poses[:, :N_ROOT])(frames)
    ground = scipy.interpolate.CubicSpline(np.arange(len(motion)), motion.velocities[:, :2])(frames)
    uniform = np.linspace(-0.5, 0.5, n_phases + 1)[:, None] * (root[-1] - root[0])
    sway = root - uniform
    sway -= sway[:-1].mean(axis=0)
    heading = root[:, 3] - sway[:, 3]
    across = -ground[:, 0] * np.sin(heading) + ground[:, 1] * np.cos(heading)
    path = np.concatenate([[0.0], np.cumsum(0.5 * (across[1:] + across[:-1]))]) * (frames[1] - frames[0])
    path = path / motion.rate_hz - np.linspace(0.0, 1.0, n_phases + 1) * path[-1] / motion.rate_hz
    lateral = path - path[:-1].mean()
    return np.column_stack([lateral, sway[:, 2:]])[:-1]


@dataclass(frozen=True, eq=False)
class WalkingModel:
    """A* = Â + B̃ c (paper A, section 6.2), with d components over T phases of C channels.

    mean : (T, C). components : (d, T, C). scales : (d,), λ, the standard deviations of the coefficients over the
    training cycles. Channels are CHANNEL_NAMES, and ROOT_CHANNELS if learned, in m/s, rad and m. cycle_rate_hz : mean
    and standard deviation of the cycles per second. explained : fraction of the (scaled) variance that the d components
    explain. n_cycles : number of training cycles. discrepancy : on held-out subjects, if known.
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
    include_root: bool = False, torso_speed: str = "forward",
) -> WalkingModel:  # fmt: skip
    """Learn the model from the walking cycles in the motions.

    Parameters
    ----------
    motions : the walks.
    variance : if n_components is None, the minimum number of components that explain more than this fraction.
    n_components : their number d.
    scaling : "none" as in the paper (speed in metres per frame at 30 Hz, angles in rad), or "joints", which weighs
        every channel by the joint displacement it causes, so that twists that move nothing use no components
    n_phases : T
    include_root : learn the root's sway too, which the paper leaves to noise.
    torso_speed : "norm", the absolute value of the torso's velocity as in the paper, or "forward", its component over
        the ground along the heading, which excludes sway and bobbing.

    Raises
    ------
    InputError : fewer than two cycles, or more components than they allow.
    """
    if scaling not in ("none", "joints"):
        raise InputError(f"prior: scaling must be 'none' or 'joints', found {scaling!r}")
    if torso_speed not in ("forward", "norm"):
        raise InputError(f"prior: torso_speed must be 'forward' or 'norm', found {torso_speed!r}")
    if not 0.0 < variance < 1.0:
        raise InputError(f"prior: variance must lie between 0 and 1, found {variance}")
    cycles = walking_cycles(motions, n_phases, include_root, torso_speed)
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
    explained = np.cumsum(singular**2) / np.sum(singular**2)
    maximum = min(m - 1, len(singular))
    d = min(min_components(explained, variance), maximum) if n_components is None else n_components
    if not 1 <= d <= maximum:
        raise InputError(f"prior: {m} cycles allow 1 to {maximum} components, found {d}")
    rates = 1.0 / cycles.durations_s
    return WalkingModel(
        mean=mean, components=rows[:d].reshape(d, n_phases, n_channels) / weights,
        scales=singular[:d] / np.sqrt(m - 1), cycle_rate_hz=(float(rates.mean()), float(rates.std(ddof=1))),
        explained=float(explained[d - 1]), n_cycles=m,
    )  # fmt: skip


def component_counts(
    cycles: Cycles, people: Mapping[str, str], n_draws: int, variance: float, rng: np.random.Generator
) -> IntArray:
    """Return the numbers of components (n_draws,) that explain more than `variance` of randomly drawn training sets.

    A training set has 8 to 13 cycles of 4 people (the paper: 13 cycles of 4 people, d = 5), channels are unscaled.
    people : by source. Raises InputError if there are cycles of fewer than 4 people.
    """
    performers = np.array([people[source] for source in cycles.sources])
    names, counts = np.unique(performers), []
    if len(names) < DRAWN_PEOPLE:
        raise InputError(f"prior: expected cycles of at least {DRAWN_PEOPLE} people, found {len(names)}")
    weights = np.array([SPEED_WEIGHT] + [1.0] * (cycles.curves.shape[2] - 1))
    for _ in range(n_draws):
        pool = np.flatnonzero(np.isin(performers, rng.choice(names, DRAWN_PEOPLE, replace=False)))
        drawn = rng.choice(pool, min(int(rng.integers(*DRAWN_CYCLES, endpoint=True)), len(pool)), replace=False)
        subset = Cycles(cycles.curves[drawn], cycles.durations_s[drawn], ())
        counts.append(len(_mpca(subset, weights, variance, None).scales))
    return np.array(counts)


def _joint_effects(cycles: Cycles, motions: Sequence[Motion]) -> FloatArray:
    """Return the root mean square displacement (C,), m, of the 14 joints per radian or metre, over the mean cycle."""
    skeleton = person_skeleton(motions[0].shape)
    poses = np.zeros((cycles.curves.shape[1], len(skeleton.dof_names)))
    poses[:, N_ROOT:] = cycles.curves.mean(axis=0)[:, ANGLES]
    measured = [skeleton.joint(name) for name in ERROR_JOINTS]
    jacobian = joint_jacobian(skeleton, poses)[:, measured]
    effects = np.maximum(np.sqrt((jacobian**2).sum(axis=2).mean(axis=(0, 1))), MIN_EFFECT_M)
    n_root = cycles.curves.shape[2] - len(CHANNEL_NAMES)
    return np.concatenate([[SPEED_LEVER_S], effects[N_ROOT:], effects[N_ROOT - len(ROOT_CHANNELS) : N_ROOT][:n_root]])


def learn_cyclic(
    motions: Sequence[Motion], n_components: int = 5, n_phases: int = 64, as_published: bool = False
) -> WalkingModel:
    """Learn the walking model of motions (paper B, section 2); missing angles are NaN in their poses.

    A missing position or heading makes the torso's speed missing. Motions without a period are excluded, with a
    warning. Deviations: the period maximises the robust SNR of `snr`; slices with less than half of their samples, at
    the ends of the sequences, are excluded, because imputed values reduce the coefficients' standard deviations; the
    components are those of `fpca_shrunk`; the torso's speed is learned too. as_published : none of them. Raises
    InputError for fewer than two motions with a period, or too few cycles.
    """
    sequences, periods, rates = [], [], []
    for motion in motions:
        channels = _motion_channels(motion)
        channels[:, 0] = 0.0 if as_published else SPEED_WEIGHT * channels[:, 0]
        try:
            period = motion_period(motion, channels[:, 1:], as_published)
        except InputError as error:
            log.warning("%s excluded from the training set: %s", motion.name, error)
            continue
        sequences.append(channels)
        periods.append(period)
        rates.append(motion.rate_hz / period)
    if len(sequences) < 2:
        raise InputError(f"prior: expected two motions with a period or more, found {len(sequences)} of {len(motions)}")
    alignment = align([channels[:, 1:] for channels in sequences], periods)
    slices = cut(sequences, _from_left_thigh_ahead(alignment), n_phases)
    mask = slices.observed.mean(axis=(1, 2)) >= (0.0 if as_published else MIN_OBSERVED)
    slices = Slices(slices.values[mask], slices.observed[mask], slices.sequence[mask], slices.cycle[mask])
    pca = (fpca_paper if as_published else fpca_shrunk)(slices, n_components)
    weights = np.array([SPEED_WEIGHT] + [1.0] * (len(CHANNEL_NAMES) - 1))
    return WalkingModel(
        mean=pca.mean / weights, components=pca.components / weights, scales=pca.scales,
        cycle_rate_hz=(float(np.mean(rates)), float(np.std(rates, ddof=1))), explained=pca.explained,
        n_cycles=len(slices.values),
    )  # fmt: skip


def _from_left_thigh_ahead(alignment: CycleAlignment) -> CycleAlignment:
    """Return the alignment of joint angles shifted to phase 0 where the left thigh is furthest ahead of the right."""
    first = len(POSE_NAMES) - alignment.reference.shape[1]
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") - first for side in ("left", "right"))
    ahead = int(np.argmax(alignment.reference[:, left] - alignment.reference[:, right]))
    offsets = (alignment.offsets - ahead / len(alignment.reference)) % 1.0
    return replace(alignment, offsets=offsets, reference=np.roll(alignment.reference, -ahead, axis=0))
