"""What gaps cost: motions with samples removed, and how well the period and the missing angles are recovered."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.cycle_alignment import Alignment, align
from workbench.motion.models.imputation import impute, impute_linear, impute_paper, impute_periodic
from workbench.motion.models.period import find_period, snr, snr_per_series
from workbench.motion.pose_sequence import LONGEST_S, SHORTEST_S, Motion, gait_events
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

BLOCK_S = (0.1, 0.5)  # shortest and longest block removed, s: 12 to 60 frames at 120 Hz
LIMBS = ("neck", "left_shoulder left_elbow", "right_shoulder right_elbow", "left_hip left_knee", "right_hip right_knee")
"""The angles lost together when a limb's markers are hidden, by the beginnings of their names."""

METHODS = ("", "_linear", "_periodic", "_paper")
log = logging.getLogger(__name__)


def remove_blocks(motion: Motion, fraction: float, rng: np.random.Generator) -> BoolArray:
    """Which samples (F, 19) of the joint angles to remove: blocks per angle, until the fraction is reached."""
    gone = np.zeros((len(motion), len(POSE_NAMES) - N_ROOT), dtype=bool)
    for angle in gone.T:
        while angle.mean() < fraction:
            length = min(len(motion), round(rng.uniform(*BLOCK_S) * motion.rate_hz))
            start = rng.integers(len(motion) - length + 1)
            angle[start : start + length] = True
    return gone


def with_gaps(motion: Motion, fraction: float, rng: np.random.Generator) -> Motion:
    """The motion with a fraction of its joint angles missing (NaN), in blocks."""
    poses = motion.poses.copy()
    poses[:, N_ROOT:][remove_blocks(motion, fraction, rng)] = np.nan
    return replace(motion, poses=poses)


def remove_markers(motion: Motion, fraction: float, rng: np.random.Generator) -> BoolArray:
    """Remove whole markers: all angles of a limb at once, half a cycle at a time."""
    names = POSE_NAMES[N_ROOT:]
    gone = np.zeros((len(motion), len(names)), dtype=bool)
    half = min(len(motion), round(0.5 * motion_period(motion, motion.poses[:, N_ROOT:])))
    for limb in LIMBS:
        angles = [i for i, name in enumerate(names) if name.startswith(tuple(limb.split()))]
        while gone[:, angles[0]].mean() < fraction:
            start = rng.integers(len(motion) - half + 1)
            gone[start : start + half, angles] = True
    return gone


def motion_period(motion: Motion, angles: FloatArray) -> float:
    """The period, in frames, of a motion's angles (F, m), looked for where a stride's duration can lie."""
    return find_period(angles, SHORTEST_S * motion.rate_hz, LONGEST_S * motion.rate_hz)


def gap_study(
    motions: Sequence[Motion], fractions: Sequence[float], rng: np.random.Generator,
    remove: Callable[[Motion, float, np.random.Generator], BoolArray] = remove_blocks,
) -> dict[str, float]:  # fmt: skip
    """Root mean square error, in degrees, of the samples imputed after a fraction of them was removed.

    For every fraction, e.g. 0.1: rmse_deg_10 for `impute`, and rmse_deg_10_linear, _periodic and _paper for the
    others. Periods, alignment and models are learned from the motions with gaps, all together. A motion whose period
    is not found is left out, with a warning; sequences_10 counts those left in. Raises InputError when none is.
    """
    measured: dict[str, float] = {}
    for fraction in tqdm(fractions, desc="gaps", disable=None):
        truths, gappy, alignment = gappy_sequences(motions, fraction, rng, remove)
        name = f"rmse_deg_{round(100 * fraction)}"
        imputed = (
            impute(gappy, alignment), impute_linear(gappy), impute_periodic(gappy, alignment),
            impute_paper(gappy, alignment),
        )  # fmt: skip
        for method, filled in zip(METHODS, imputed, strict=True):
            measured[name + method] = rmse_deg(truths, gappy, filled)
        measured[f"sequences_{round(100 * fraction)}"] = float(len(gappy))
    return measured


def gappy_sequences(
    motions: Sequence[Motion], fraction: float, rng: np.random.Generator,
    remove: Callable[[Motion, float, np.random.Generator], BoolArray] = remove_blocks,
) -> tuple[list[FloatArray], list[FloatArray], Alignment]:  # fmt: skip
    """The joint angles (F_i, 19) of motions, the same with NaN where removed, and the alignment found from those."""
    truths, gappy, periods = [], [], []
    for motion in motions:
        truth = motion.poses[:, N_ROOT:]
        try:
            series = np.where(remove(motion, fraction, rng), np.nan, truth)
            periods.append(motion_period(motion, series))
        except InputError as error:
            log.warning("%s left out of the study of gaps: %s", motion.name, error)
            continue
        truths.append(truth)
        gappy.append(series)
    if not periods:
        raise InputError(f"gaps: expected cyclic motions, found no period in any of {len(motions)}")
    return truths, gappy, align(gappy, periods)


def rmse_deg(truths: Sequence[FloatArray], gappy: Sequence[FloatArray], filled: Sequence[FloatArray]) -> float:
    """Root mean square error of what was filled in for the NaN of `gappy`, degrees; NaN where nothing was missing."""
    errors = [(f - t)[np.isnan(g)] for t, g, f in zip(truths, gappy, filled, strict=True)]
    return float(np.rad2deg(np.sqrt(np.mean(np.concatenate(errors) ** 2))))


@dataclass(frozen=True, eq=False)
class ClipPeriods:
    """A motion's stride period, in frames: by its hip events, by its SNR, and by its SNR with samples removed.

    events: NaN where there is no stride between two events. found, found_gappy: NaN where no period was found.
    candidates: (P,) frames. snr: (P,), accumulated. snr_per_angle: (P, 19). Both without gaps.
    """

    name: str
    rate_hz: float
    events: float
    found: float
    found_gappy: float
    candidates: FloatArray
    snr: FloatArray
    snr_per_angle: FloatArray

    @property
    def errors_pct(self) -> tuple[float, float]:
        """Deviations from the events' period, %, of that found without and with gaps; infinite for one not found."""
        full, gappy = (np.inf if np.isnan(period) else period for period in (self.found, self.found_gappy))
        return 100.0 * (full / self.events - 1.0), 100.0 * (gappy / self.events - 1.0)


def period_study(
    motions: Sequence[Motion], rng: np.random.Generator, fraction: float = 0.3
) -> dict[str, float | tuple[ClipPeriods, ...] | Mapping[str, FloatArray]]:
    """Tell how well the period is found, without and with a fraction of the samples removed in blocks.

    period_error_max_pct, period_error_max_pct_30: the largest deviation from the mean distance of hip events.
    period_error_median_pct, …_median_pct_30. white_noise_peak_ratio: the largest over the median accumulated SNR of
    white noise of the median motion's length, the worse of those without and with gaps. clips: a ClipPeriods for
    every motion. white_noise: {"candidates", "snr", "snr_gappy"}. Motions with fewer than two events have nothing to
    be compared with and are left out of the errors, with a warning; n_clips counts the others. A period that is not
    found counts as an infinite error. Raises InputError when no motion is left.
    """
    clips = [_clip_periods(motion, fraction, rng) for motion in tqdm(motions, desc="periods", disable=None)]
    measured = [clip for clip in clips if np.isfinite(clip.events)]
    for clip in clips:
        if clip not in measured:
            log.warning("%s left out of the study of periods: fewer than two hip events", clip.name)
    if not measured:
        raise InputError(f"period: expected walks of two strides or more, found none among {len(motions)} motions")
    errors = np.abs([clip.errors_pct for clip in measured])
    noise = _white_noise(motions, fraction, rng)
    percent = round(100 * fraction)
    return {
        "period_error_max_pct": float(errors[:, 0].max()),
        f"period_error_max_pct_{percent}": float(errors[:, 1].max()),
        "period_error_median_pct": float(np.median(errors[:, 0])),
        f"period_error_median_pct_{percent}": float(np.median(errors[:, 1])),
        "white_noise_peak_ratio": max(float(noise[key].max() / np.median(noise[key])) for key in ("snr", "snr_gappy")),
        "n_clips": float(len(measured)), "clips": tuple(clips), "white_noise": noise,
    }  # fmt: skip


def event_period(motion: Motion) -> float:
    """Mean distance, in frames, between hip events of one kind: the left thigh furthest ahead, or the right one.

    `gait_events` and its mirror image: in clips of two or three strides one kind of event alone sees just one of
    them. NaN where `gait_events` finds fewer than two.
    """
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") for side in ("left", "right"))
    poses = motion.poses.copy()
    poses[:, [left, right]] = poses[:, [right, left]]
    events = gait_events(motion)
    if len(events) < 2:
        return float("nan")
    return float(np.concatenate([np.diff(events), np.diff(gait_events(replace(motion, poses=poses)))]).mean())


def _clip_periods(motion: Motion, fraction: float, rng: np.random.Generator) -> ClipPeriods:
    angles = motion.poses[:, N_ROOT:]
    gappy = np.where(remove_blocks(motion, fraction, rng), np.nan, angles)
    candidates = _whole_periods(motion)
    return ClipPeriods(
        name=motion.name, rate_hz=motion.rate_hz, events=event_period(motion), found=_period_or_nan(motion, angles),
        found_gappy=_period_or_nan(motion, gappy), candidates=candidates, snr=snr(angles, candidates),
        snr_per_angle=snr_per_series(angles, candidates),
    )  # fmt: skip


def _whole_periods(motion: Motion) -> FloatArray:
    """Whole numbers of frames from the shortest stride's to the longest that fits twice, for figures."""
    longest = min(LONGEST_S * motion.rate_hz, len(motion) / 2)
    return np.arange(round(SHORTEST_S * motion.rate_hz), int(longest) + 1, dtype=np.float64)


def _period_or_nan(motion: Motion, angles: FloatArray) -> float:
    try:
        return motion_period(motion, angles)
    except InputError as error:
        log.warning("%s: %s", motion.name, error)
        return float("nan")


def _white_noise(motions: Sequence[Motion], fraction: float, rng: np.random.Generator) -> dict[str, FloatArray]:
    median = sorted(motions, key=len)[len(motions) // 2]
    noise = rng.standard_normal((len(median), len(POSE_NAMES) - N_ROOT))
    gappy = np.where(remove_blocks(median, fraction, rng), np.nan, noise)
    candidates = _whole_periods(median)
    return {"candidates": candidates, "snr": snr(noise, candidates), "snr_gappy": snr(gappy, candidates)}
