"""How the period of a walk is found (paper B, section 2.1, fig. 1 left)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.study import Curves, StudyResult
from workbench.motion.models.gaps import ClipPeriods, period_study
from workbench.studies.learning import ANGLES, WalkStudy, angle, title
from workbench.utils.arrays import FloatArray

STATED_PCT = 2.0
"""Clips whose periods differ by more are named."""


@dataclass(frozen=True, kw_only=True)
class PeriodSnr(WalkStudy):
    """Signal-to-noise ratio over the period, and the periods found against those of the hip events.

    missing: part of the samples that is removed, in blocks, for a second measurement. Metrics: those of `period_study`.
    """

    missing: float = 0.3

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Find every walk's period twice. Raises InputError as `training_motions` and `period_study` do."""
        study = period_study(self.walks(), rng, self.missing)
        every, noise = study["clips"], study["white_noise"]
        assert isinstance(every, tuple)
        assert isinstance(noise, Mapping)
        clips = sorted((clip for clip in every if np.isfinite(clip.events)), key=lambda clip: abs(clip.errors_pct[0]))
        metrics = {name: value for name, value in study.items() if isinstance(value, float)}
        shown = [clips[k] for k in sorted({0, len(clips) // 2, len(clips) - 1})]  # from the best to the worst
        figures = (*map(_clip, shown), _all(clips, noise), _deviations(clips, self.missing))
        return StudyResult(metrics, figures, _note(clips, metrics, self.missing))


def on_grid(x: FloatArray, places: FloatArray, values: FloatArray) -> FloatArray:
    """Put values (k,) at places (k,), which are among x (n,), as a curve (n,) over x; NaN elsewhere."""
    curve = np.full(len(x), np.nan)
    curve[np.searchsorted(x, places)] = values
    return curve


def log10(ratios: FloatArray) -> FloatArray:
    """Take decimal logarithms; NaN for ratios that are not positive.

    A deviation from the paper's figure, which is linear: single angles differ by powers of ten at the peak.
    """
    return np.log10(np.where(ratios > 0.0, ratios, np.nan))


def _clip(clip: ClipPeriods) -> Curves:
    curves = {"accumulated": log10(clip.snr)}
    each = {title(name): log10(clip.snr_per_angle[:, angle(name)]) for name in ANGLES}
    curves |= {label.removesuffix(" flexion"): each.pop(label) for label in list(each)[:4]}
    marks = {"found": clip.found, "hip events": clip.events}
    marks = {label: period for label, period in marks.items() if np.isfinite(period)}
    x_name = f"period in frames at {clip.rate_hz:g} Hz"
    return Curves(f"period/{clip.name}", clip.candidates, curves, x_name, "log₁₀ SNR", marks=marks, faint=each)


def _all(clips: Sequence[ClipPeriods], noise: Mapping[str, FloatArray]) -> Curves:
    """Accumulated ratios over the period in seconds, since clips may differ in their rates; noise at the first's."""
    rate_hz = clips[0].rate_hz
    x = np.unique(np.concatenate([noise["candidates"] / rate_hz, *(clip.candidates / clip.rate_hz for clip in clips)]))
    faint = {clip.name: on_grid(x, clip.candidates / clip.rate_hz, log10(clip.snr)) for clip in clips}
    curves = {"white noise": noise["snr"], "white noise with gaps": noise["snr_gappy"]}
    drawn = {label: on_grid(x, noise["candidates"] / rate_hz, log10(values)) for label, values in curves.items()}
    name = "period/all walks (thin) and white noise"
    return Curves(name, x, drawn, "period in seconds", "log₁₀ accumulated SNR", faint=faint)


def _deviations(clips: Sequence[ClipPeriods], missing: float) -> Curves:
    errors = np.abs([clip.errors_pct for clip in clips])
    errors[~np.isfinite(errors)] = np.nan  # not found: nothing to draw
    limits = {"2 %": np.full(len(clips), STATED_PCT)}
    curves = {"all samples": errors[:, 0], f"{100 * missing:.0f} % removed": errors[:, 1], **limits}
    rank = np.arange(1.0, len(clips) + 1.0)
    return Curves("period/deviation from hip events", rank, curves, "walks, sorted by deviation", "percent")


def _note(clips: Sequence[ClipPeriods], metrics: Mapping[str, float], missing: float) -> str:
    percent = round(100 * missing)
    outside = [f"{clip.name} ({clip.errors_pct[0]:+.1f} %)" for clip in clips if abs(clip.errors_pct[0]) > STATED_PCT]
    beyond = f"Beyond {STATED_PCT:g} %: {', '.join(outside)}." if outside else f"None is off by {STATED_PCT:g} %."
    return (
        f"**Paper B, fig. 1 left.** Signal-to-noise ratio of folded joint angles over the candidate period (thin: the "
        f"right side's): of {len(clips)} walks those found best, middling and worst, with the stride that their hip "
        f"events tell. White noise stays flat (largest over median {metrics['white_noise_peak_ratio']:.2f}), so that a "
        f"peak means a period. Deviation from the hip events: at most {metrics['period_error_max_pct']:.2f} %, with "
        f"{percent} % of the samples removed {metrics[f'period_error_max_pct_{percent}']:.2f} %. {beyond}"
    )
