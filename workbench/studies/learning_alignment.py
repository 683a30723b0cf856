"""How walks are brought to one phase (paper B, section 2.1, fig. 1 right)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.skeleton import N_ROOT
from workbench.core.study import Curves, StudyResult
from workbench.motion.models.cycle_alignment import Alignment, align
from workbench.studies.learning import WalkStudy, angle, closed, cyclic, degrees, phases, title
from workbench.utils.arrays import FloatArray

SHOWN = ("left_hip_flexion", "left_knee_flexion", "left_shoulder_flexion")
N_BINS = 64


@dataclass(frozen=True, kw_only=True)
class AlignCycles(WalkStudy):
    """Folded walks before and after alignment, and the error of every pass.

    Metrics: n_sequences; passes; deviation_before and deviation_after, the root mean square deviation from the
    reference in standard deviations of the angles.
    """

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Align and show; draws nothing. Raises InputError when no walk has a period."""
        motions, periods = cyclic(self.walks())
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
        count = np.arange(float(len(deviations)))
        errors = {"all walks": deviations}
        figures = (
            *(_cycle(names, before, name, "before", None) for name in SHOWN),
            Curves("alignment/error", count, errors, "pass", "RMS deviation in standard deviations"),
            *(_cycle(names, after, name, "after", alignment) for name in SHOWN),
        )
        return StudyResult(metrics, figures, _note(metrics))


def fold(series: FloatArray, at: FloatArray) -> FloatArray:
    """Average a series (F, m) at phases (F,), cycles, in equal bins of the cycle: (64, m), NaN in an empty bin."""
    bins = np.floor((at % 1.0) * N_BINS).astype(np.int64) % N_BINS
    sums, count = np.zeros((N_BINS, series.shape[1])), np.bincount(bins, minlength=N_BINS)[:, None]
    np.add.at(sums, bins, series)
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


def _cycle(
    names: Sequence[str], folded: Sequence[FloatArray], name: str, when: str, alignment: Alignment | None
) -> Curves:
    """Every walk's folded angle, and their mean or, after an alignment, its reference spline."""
    each = [closed(curve[:, angle(name)]) for curve in folded]
    if alignment is None:
        curves = {"mean": np.nanmean(each, axis=0)}
    else:
        step = len(alignment.reference) // N_BINS
        curves = {"reference spline": closed(alignment.reference[::step, angle(name)])}
    heading, faint = f"alignment/{title(name)} {when}", dict(zip(names, each, strict=True))
    return Curves(heading, phases(N_BINS), degrees(curves), "cycle", "degrees", faint=degrees(faint))


def _note(metrics: dict[str, float]) -> str:
    return (
        f"**Paper B, fig. 1 right.** {metrics['n_sequences']:.0f} walks, each folded by its own period (thin): as they "
        f"begin, and shifted to deviate least from a common periodic regression spline. The deviation falls from "
        f"{metrics['deviation_before']:.2f} to {metrics['deviation_after']:.2f} standard deviations of the angles in "
        f"{metrics['passes']:.0f} passes and never rises; what is left is how people differ."
    )
