"""Period and common phase of walks (paper B, section 2.1, fig. 1)."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.study import Curves, StudyResult
from workbench.motion.models.cycle_alignment import CycleAlignment, align, motion_period, snr, snr_per_series
from workbench.motion.models.imputation import remove_blocks
from workbench.motion.pose_sequence import MAX_CYCLE_S, MIN_CYCLE_S, Motion, gait_events
from workbench.studies.learning import ANGLES, WalkStudy, angle, closed, cyclic, degrees, phases, title
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

MAX_DEVIATION_PCT = 2.0
"""The note names clips whose periods deviate by more."""
SHOWN = ("left_hip_flexion", "left_knee_flexion", "left_shoulder_flexion")
N_BINS = 64
log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PeriodSnr(WalkStudy):
    """Signal-to-noise ratio over the period, and estimated periods compared with hip events (B, fig. 1 left).

    missing_fraction: part of the samples that is removed, in blocks, for a second measurement. summed: accumulate the
    ratios of the angles by their sum, as in the paper, see `snr`. Metrics: those of `period_study`.
    """

    missing_fraction: float = 0.3
    summed: bool = False

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Estimate every walk's period twice. Raises InputError as `training_motions` and `period_study` do."""
        metrics, clips, noise = period_study(self.walks(), rng, self.missing_fraction, self.summed)
        clips = sorted(clips, key=lambda clip: abs(clip.errors_pct[0]))
        shown = [clips[k] for k in sorted({0, len(clips) // 2, len(clips) - 1})]  # from the best to the worst
        figures = (*map(_clip, shown), _all(clips, noise), _deviations(clips, self.missing_fraction))
        return StudyResult(metrics, figures, _period_note(clips, metrics, self.missing_fraction))


@dataclass(frozen=True, kw_only=True)
class AlignCycles(WalkStudy):
    """Folded walks before and after alignment, and the error of every pass (paper B, fig. 1 right).

    summed: as for `PeriodSnr`, for the walks' periods. Metrics: n_sequences; passes; deviation_before and
    deviation_after, the root mean square deviation from the reference in standard deviations of the angles.
    """

    summed: bool = False

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Align and plot; not random. Raises InputError if no walk has a period."""
        motions, periods = cyclic(self.walks(), self.summed)
        sequences = [motion.poses[:, N_ROOT:] for motion in motions]
        alignment = align(sequences, periods)
        deviations = np.sqrt(alignment.errors / sum(series.size for series in sequences))
        metrics = {
            "n_sequences": float(len(sequences)),
            "n_passes": float(len(deviations) - 1),
            "deviation_before": float(deviations[0]),
            "deviation_after": float(deviations[-1]),
        }
        before = [fold(series, np.arange(len(series)) / p) for series, p in zip(sequences, periods, strict=True)]
        after = [fold(series, alignment.phases(i, len(series))) for i, series in enumerate(sequences)]
        names = [motion.name for motion in motions]
        count = np.arange(float(len(deviations)))
        errors = {"all walks": deviations}
        figures = (
            *(_cycle(names, before, name, "before", None) for name in SHOWN),
            Curves("alignment/error", count, errors, "pass", "RMS deviation in standard deviations"),
            *(_cycle(names, after, name, "after", alignment) for name in SHOWN),
        )
        return StudyResult(metrics, figures, _alignment_note(metrics))


@dataclass(frozen=True, eq=False)
class _ClipPeriods:
    """A motion's stride period, in frames: of its hip events, by its SNR, and by its SNR with samples removed.

    events: NaN if there is no stride between two events. estimate, estimate_gappy: NaN if no period was found.
    candidates: (P,), frames. snr: (P,), accumulated. snr_per_angle: (P, 19). Both without gaps.
    """

    name: str
    rate_hz: float
    events: float
    estimate: float
    estimate_gappy: float
    candidates: FloatArray
    snr: FloatArray
    snr_per_angle: FloatArray

    @property
    def errors_pct(self) -> tuple[float, float]:
        """Return the deviations from the events' period, %, without and with gaps; infinite if no period was found."""
        full, gappy = (np.inf if np.isnan(period) else period for period in (self.estimate, self.estimate_gappy))
        return 100.0 * (full / self.events - 1.0), 100.0 * (gappy / self.events - 1.0)


def period_study(
    motions: Sequence[Motion], rng: np.random.Generator, fraction: float = 0.3, summed: bool = False
) -> tuple[dict[str, float], list[_ClipPeriods], dict[str, FloatArray]]:
    """Measure the error of the estimated period, without and with a fraction of the samples removed in blocks.

    summed : see `snr`.

    Returns
    -------
    metrics : period_error_max_pct, period_error_max_pct_30: the largest deviation from the mean distance of hip events.
        period_error_median_pct, …_median_pct_30. white_noise_peak_ratio: the largest over the median accumulated SNR
        of white noise of the median motion's length, the worse of those without and with gaps. n_clips
    clips : of every motion with at least two events; others are omitted, with a warning. A period that is not found
        counts as an infinite error
    white noise : {"candidates", "snr", "snr_gappy"}

    Raises
    ------
    InputError : there is no such motion
    """
    periods = [_clip_periods(motion, fraction, rng, summed) for motion in tqdm(motions, desc="periods", disable=None)]
    clips = [clip for clip in periods if np.isfinite(clip.events)]
    for clip in periods:
        if clip not in clips:
            log.warning("%s omitted from the study of periods: fewer than two hip events", clip.name)
    if not clips:
        raise InputError(f"period: expected walks of two strides or more, found none among {len(motions)} motions")
    errors = np.abs([clip.errors_pct for clip in clips])
    noise = _white_noise(motions, fraction, rng, summed)
    percent = round(100 * fraction)
    metrics = {
        "period_error_max_pct": float(errors[:, 0].max()),
        f"period_error_max_pct_{percent}": float(errors[:, 1].max()),
        "period_error_median_pct": float(np.median(errors[:, 0])),
        f"period_error_median_pct_{percent}": float(np.median(errors[:, 1])),
        "white_noise_peak_ratio": max(float(noise[key].max() / np.median(noise[key])) for key in ("snr", "snr_gappy")),
        "n_clips": float(len(clips)),
    }
    return metrics, clips, noise


def event_period(motion: Motion) -> float:
    """Return the mean distance, in frames, between hip events of one kind: maximum flexion of the left or right hip.

    Both kinds are used (`gait_events` and its mirror image), as clips of two or three strides may have a single
    distance of one kind. NaN if `gait_events` finds fewer than two.
    """
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") for side in ("left", "right"))
    poses = motion.poses.copy()
    poses[:, [left, right]] = poses[:, [right, left]]
    events = gait_events(motion)
    if len(events) < 2:
        return float("nan")
    return float(np.concatenate([np.diff(events), np.diff(gait_events(replace(motion, poses=poses)))]).mean())


def _clip_periods(motion: Motion, fraction: float, rng: np.random.Generator, summed: bool) -> _ClipPeriods:
    angles = motion.poses[:, N_ROOT:]
    gappy = np.where(remove_blocks(motion, fraction, rng), np.nan, angles)
    candidates = _whole_periods(motion)
    return _ClipPeriods(
        name=motion.name, rate_hz=motion.rate_hz, events=event_period(motion),
        estimate=_period_or_nan(motion, angles, summed), estimate_gappy=_period_or_nan(motion, gappy, summed),
        candidates=candidates, snr=snr(angles, candidates, summed),
        snr_per_angle=snr_per_series(angles, candidates),
    )  # fmt: skip


def _whole_periods(motion: Motion) -> FloatArray:
    """Return integer periods, in frames, from the shortest stride to the longest that fits twice, for figures."""
    longest = min(MAX_CYCLE_S * motion.rate_hz, len(motion) / 2)
    return np.arange(round(MIN_CYCLE_S * motion.rate_hz), int(longest) + 1, dtype=np.float64)


def _period_or_nan(motion: Motion, angles: FloatArray, summed: bool) -> float:
    try:
        return motion_period(motion, angles, summed)
    except InputError as error:
        log.warning("%s: %s", motion.name, error)
        return float("nan")


def _white_noise(
    motions: Sequence[Motion], fraction: float, rng: np.random.Generator, summed: bool
) -> dict[str, FloatArray]:
    median = sorted(motions, key=len)[len(motions) // 2]
    noise = rng.standard_normal((len(median), len(POSE_NAMES) - N_ROOT))
    gappy = np.where(remove_blocks(median, fraction, rng), np.nan, noise)
    candidates = _whole_periods(median)
    accumulated = {"snr": snr(noise, candidates, summed), "snr_gappy": snr(gappy, candidates, summed)}
    return {"candidates": candidates, **accumulated}


def _on_grid(x: FloatArray, positions: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (k,) at positions (k,), which are among x (n,), as a curve (n,) over x; NaN elsewhere."""
    curve = np.full(len(x), np.nan)
    curve[np.searchsorted(x, positions)] = values
    return curve


def _log10(ratios: FloatArray) -> FloatArray:
    """Return decimal logarithms; NaN for ratios that are not positive.

    A deviation from the paper's figure, which is linear: single angles differ by powers of ten at the peak.
    """
    return np.log10(np.where(ratios > 0.0, ratios, np.nan))


def _clip(clip: _ClipPeriods) -> Curves:
    curves = {"accumulated": _log10(clip.snr)}
    each = {title(name): _log10(clip.snr_per_angle[:, angle(name)]) for name in ANGLES}
    curves |= {label.removesuffix(" flexion"): each.pop(label) for label in list(each)[:4]}
    marks = {"found": clip.estimate, "hip events": clip.events}
    marks = {label: period for label, period in marks.items() if np.isfinite(period)}
    x_name = f"period in frames at {clip.rate_hz:g} Hz"
    return Curves(f"period/{clip.name}", clip.candidates, curves, x_name, "log₁₀ SNR", marks=marks, faint=each)


def _all(clips: Sequence[_ClipPeriods], noise: Mapping[str, FloatArray]) -> Curves:
    """Return accumulated ratios over the period in seconds, as rates may differ; noise at the first clip's rate."""
    rate_hz = clips[0].rate_hz
    x = np.unique(np.concatenate([noise["candidates"] / rate_hz, *(clip.candidates / clip.rate_hz for clip in clips)]))
    faint = {clip.name: _on_grid(x, clip.candidates / clip.rate_hz, _log10(clip.snr)) for clip in clips}
    curves = {"white noise": noise["snr"], "white noise with gaps": noise["snr_gappy"]}
    on_grid = {label: _on_grid(x, noise["candidates"] / rate_hz, _log10(values)) for label, values in curves.items()}
    name = "period/all walks (thin) and white noise"
    return Curves(name, x, on_grid, "period in seconds", "log₁₀ accumulated SNR", faint=faint)


def _deviations(clips: Sequence[_ClipPeriods], missing_fraction: float) -> Curves:
    errors = np.abs([clip.errors_pct for clip in clips])
    errors[~np.isfinite(errors)] = np.nan  # not found: not drawn
    limits = {"2 %": np.full(len(clips), MAX_DEVIATION_PCT)}
    curves = {"all samples": errors[:, 0], f"{100 * missing_fraction:.0f} % removed": errors[:, 1], **limits}
    rank = np.arange(1.0, len(clips) + 1.0)
    return Curves("period/deviation from hip events", rank, curves, "walks, sorted by deviation", "percent")


def _period_note(clips: Sequence[_ClipPeriods], metrics: Mapping[str, float], missing_fraction: float) -> str:
    percent = round(100 * missing_fraction)
    outside = [
        f"{clip.name} ({clip.errors_pct[0]:+.1f} %)" for clip in clips if abs(clip.errors_pct[0]) > MAX_DEVIATION_PCT
    ]
    above = f"Above {MAX_DEVIATION_PCT:g} %: {', '.join(outside) or 'none'}."
    return (
        "**Paper B, fig. 1 left.** Signal-to-noise ratio of folded joint angles over the candidate period (thin: the "
        f"right side's): of {len(clips)} walks those with the smallest, median and largest deviation, with the stride "
        f"of their hip events. White noise is flat (maximum over median {metrics['white_noise_peak_ratio']:.2f}), so "
        f"that a peak indicates a period. Deviation from the hip events: at most "
        f"{metrics['period_error_max_pct']:.2f} %, with {percent} % of the samples removed "
        f"{metrics[f'period_error_max_pct_{percent}']:.2f} %. {above}"
    )


def fold(series: FloatArray, at: FloatArray) -> FloatArray:
    """Return means (64, m) of a series (F, m) at phases (F,), cycles, in equal bins; NaN in an empty bin."""
    bins = np.floor((at % 1.0) * N_BINS).astype(np.int64) % N_BINS
    sums, count = np.zeros((N_BINS, series.shape[1])), np.bincount(bins, minlength=N_BINS)[:, None]
    np.add.at(sums, bins, series)
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


def _cycle(
    names: Sequence[str], folded: Sequence[FloatArray], name: str, when: str, alignment: CycleAlignment | None
) -> Curves:
    """Return every walk's folded angle, and their mean or, after an alignment, its reference spline."""
    each = [closed(curve[:, angle(name)]) for curve in folded]
    if alignment is None:
        curves = {"mean": np.nanmean(each, axis=0)}
    else:
        step = len(alignment.reference) // N_BINS
        curves = {"reference spline": closed(alignment.reference[::step, angle(name)])}
    heading, faint = f"alignment/{title(name)} {when}", dict(zip(names, each, strict=True))
    return Curves(heading, phases(N_BINS), degrees(curves), "cycle", "degrees", faint=degrees(faint))


def _alignment_note(metrics: dict[str, float]) -> str:
    return (
        f"**Paper B, fig. 1 right.** {metrics['n_sequences']:.0f} walks, each folded by its own period (thin): "
        "unaligned, and shifted to minimise the deviation from a common periodic regression spline. The deviation "
        f"decreases monotonically from {metrics['deviation_before']:.2f} to {metrics['deviation_after']:.2f} standard "
        f"deviations of the angles in {metrics['n_passes']:.0f} passes; the remainder is the difference between people."
    )
