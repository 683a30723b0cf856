"""How well missing joint angles are filled in (paper B, section 2.2)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.skeleton import N_ROOT
from workbench.core.study import Curves, StudyResult
from workbench.motion.models.gaps import METHODS, gap_study, gappy_sequences, remove_markers
from workbench.motion.models.imputation import impute, impute_linear, impute_paper, impute_periodic
from workbench.motion.pose_sequence import Motion
from workbench.studies.learning import WalkStudy, angle, cyclic, degrees, title
from workbench.utils.arrays import BoolArray
from workbench.utils.errors import InputError

NAMES = dict(zip(METHODS, ("ours", "linear", "periodic spline", "paper's FPCA"), strict=True))
SHOWN = ("left_hip_flexion", "left_knee_flexion", "right_shoulder_flexion", "right_elbow_flexion")


@dataclass(frozen=True, kw_only=True)
class ImputeGaps(WalkStudy):
    """Error of the imputed samples, by method and by how much was removed; and one walk filled in.

    fractions: parts of the samples removed. The walk shown is the one filled in middling well, at the middle fraction.
    Metrics: those of `gap_study` with blocks removed; with _markers at the end, with whole markers removed for half a
    cycle.
    """

    subjects: Sequence[str] | None = ("08", "16", "32", "35", "38")
    fractions: Sequence[float] = (0.1, 0.2, 0.3)

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Remove, fill in, compare.

        Raises InputError for a fraction outside 0 to 0.9, and as `training_motions` and `gap_study` do.
        """
        if not self.fractions or not all(0.0 < fraction <= 0.9 for fraction in self.fractions):
            raise InputError(f"study: fractions must lie between 0 and 0.9, found {list(self.fractions)}")
        motions, _ = cyclic(self.walks())
        fractions = sorted(self.fractions)
        blocks = gap_study(motions, fractions, rng)
        markers = gap_study(motions, fractions, rng, remove_markers)
        metrics = blocks | {f"{name}_markers": value for name, value in markers.items()}
        figures = (
            _errors("blocks removed", fractions, blocks),
            _errors("markers removed", fractions, markers),
            *_filled(motions, fractions[len(fractions) // 2], rng),
        )
        return StudyResult(metrics, figures, _note(fractions, metrics))


def _errors(name: str, fractions: Sequence[float], measured: Mapping[str, float]) -> Curves:
    percents = np.array([round(100 * fraction) for fraction in fractions])
    curves = {label: np.array([measured[f"rmse_deg_{p}{method}"] for p in percents]) for method, label in NAMES.items()}
    return Curves(f"gaps/{name}", percents.astype(np.float64), curves, "percent missing", "RMSE in degrees")


def _filled(motions: Sequence[Motion], fraction: float, rng: np.random.Generator) -> list[Curves]:
    """A few angles of one walk over time: what was observed, and in its gaps the truth and every method."""
    truths, gappy, alignment = gappy_sequences(motions, fraction, rng)
    filled = (impute(gappy, alignment), impute_linear(gappy), impute_periodic(gappy, alignment))
    methods = dict(zip(NAMES.values(), (*filled, impute_paper(gappy, alignment)), strict=True))
    squares = [np.mean((f - t)[np.isnan(g)] ** 2) for f, t, g in zip(filled[0], truths, gappy, strict=True)]
    k = int(np.argsort(squares)[len(squares) // 2])
    motion = next(motion for motion in motions if np.array_equal(motion.poses[:, N_ROOT:], truths[k]))
    time = np.arange(len(motion)) / motion.rate_hz
    figures = []
    for name in SHOWN:
        column = angle(name)
        gap = in_gaps(np.isnan(gappy[k][:, column]))
        curves = {label: np.where(gap, sequences[k][:, column], np.nan) for label, sequences in methods.items()}
        curves |= {"truth": np.where(gap, truths[k][:, column], np.nan), "observed": gappy[k][:, column]}
        heading = f"gaps/{motion.name}, {title(name)}, {100 * fraction:.0f} % removed"
        figures.append(Curves(heading, time, degrees(curves), "time in seconds", "degrees"))
    return figures


def in_gaps(missing: BoolArray) -> BoolArray:
    """Mark missing samples (F,) and their neighbours, so that a curve drawn over a gap meets the observed ones."""
    return np.convolve(missing, np.ones(3), mode="same") > 0.0


def _note(fractions: Sequence[float], metrics: Mapping[str, float]) -> str:
    percent = round(100 * fractions[len(fractions) // 2])
    here = f"rmse_deg_{percent}"
    return (
        f"**Paper B, section 2.2.** Samples of {metrics[f'sequences_{percent}']:.0f} walks were removed in blocks of "
        f"0.1–0.5 s per angle, or all angles of a limb for half a cycle as when its markers are hidden, and filled in. "
        f"At {percent} % blocks the error is {metrics[here]:.2f}° ours (functional PCA with softened singular values, "
        f"plus the interpolated residual), {metrics[here + '_paper']:.2f}° by the paper's plain algorithm, "
        f"{metrics[here + '_periodic']:.2f}° by a periodic spline per walk, {metrics[here + '_linear']:.2f}° by linear "
        f"interpolation; with markers hidden {metrics[here + '_markers']:.2f}° ours."
    )
