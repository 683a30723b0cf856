"""How walks are brought to one phase (paper B, section 2.1, fig. 1 right)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT
from workbench.core.study import Curves, StudyResult
from workbench.learning.alignment import Alignment, align
from workbench.studies.learning import angle, closed, cyclic, degrees, phases, title, walks

SHOWN = ("left_hip_flexion", "left_knee_flexion", "left_shoulder_flexion")
N_BINS = 64


@dataclass(frozen=True, kw_only=True)
class AlignCycles:
    """Folded walks before and after alignment, and the error of every pass.

    motions, data, cache, subjects: as for `training_motions`. Metrics: n_sequences; passes; deviation_before and
    deviation_after, the root mean square deviation from the reference in standard deviations of the angles.
    """

    motions: str = "builtin"
    data: str | None = None
    cache: str = "~/.cache/workbench"
    subjects: Sequence[str] | None = None

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Align and show; draws nothing. Raises InputError when no walk has a period."""
        motions, periods = cyclic(walks(self.motions, self.data, self.cache, self.subjects))
        sequences = [motion.poses[:, N_ROOT:] for motion in motions]
        alignment = align(sequences, periods)
        deviations = np.sqrt(alignment.errors / sum(series.size for series in sequences))
        metrics = {
            "n_sequences": float(len(sequences)),
            "passes": float(len(deviations) - 1),
            "deviation_before": float(deviations[0]),
            "deviation_after": float(deviations[-1]),
        }
        before = [fold(series, np.arange(len(series)) / p) for series, p in zip(sequences, periods, strict=True)]
        after = [fold(series, alignment.phases(i, len(series))) for i, series in enumerate(sequences)]
        names = [motion.name for motion in motions]
        figures = (
            *(_before(names, before, name) for name in SHOWN),
            _errors(deviations),
            *(_after(names, after, alignment, name) for name in SHOWN),
        )
        return StudyResult(metrics, figures, _note(metrics))


def fold(series: FloatArray, at: FloatArray) -> FloatArray:
    """Mean (64, m) of a series (F, m) in equal bins of the cycle, at phases (F,) in cycles; NaN in an empty bin."""
    bins = np.floor((at % 1.0) * N_BINS).astype(np.int64) % N_BINS
    sums, count = np.zeros((N_BINS, series.shape[1])), np.bincount(bins, minlength=N_BINS)[:, None]
    np.add.at(sums, bins, series)
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


def _before(names: Sequence[str], folded: Sequence[FloatArray], name: str) -> Curves:
    curves = [closed(curve[:, angle(name)]) for curve in folded]
    mean = {"mean": np.nanmean(curves, axis=0)}
    return _cycle(f"alignment/{title(name)} before", mean, dict(zip(names, curves, strict=True)))


def _after(names: Sequence[str], folded: Sequence[FloatArray], alignment: Alignment, name: str) -> Curves:
    faint = {label: closed(curve[:, angle(name)]) for label, curve in zip(names, folded, strict=True)}
    spline = alignment.reference[:: len(alignment.reference) // N_BINS, angle(name)]
    return _cycle(f"alignment/{title(name)} after", {"reference spline": closed(spline)}, faint)


def _cycle(name: str, curves: dict[str, FloatArray], faint: dict[str, FloatArray]) -> Curves:
    return Curves(name, phases(N_BINS), degrees(curves), "cycle", "degrees", faint=degrees(faint))


def _errors(deviations: FloatArray) -> Curves:
    count = np.arange(float(len(deviations)))
    return Curves("alignment/error", count, {"all walks": deviations}, "pass", "RMS deviation in standard deviations")


def _note(metrics: dict[str, float]) -> str:
    return (
        f"**Paper B, fig. 1 right.** {metrics['n_sequences']:.0f} walks, each folded by its own period (thin): as they "
        f"begin, and shifted to deviate least from a common periodic regression spline. The deviation falls from "
        f"{metrics['deviation_before']:.2f} to {metrics['deviation_after']:.2f} standard deviations of the angles in "
        f"{metrics['passes']:.0f} passes and never rises; what is left is how people differ."
    )
