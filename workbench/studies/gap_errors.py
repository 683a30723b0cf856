"""Errors of imputed joint angles (paper B, section 2.2)."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.study import Curves, StudyResult
from workbench.motion.models.cycle_alignment import CycleAlignment, align, motion_period
from workbench.motion.models.imputation import impute, impute_linear, impute_paper, impute_periodic, remove_blocks
from workbench.motion.pose_sequence import Motion
from workbench.studies.learning import WalkStudy, angle, cyclic, degrees, title
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

LABELS = {"": "ours", "_linear": "linear", "_periodic": "periodic spline", "_paper": "paper's FPCA"}
"""Methods by the suffix of their metrics' names."""
LIMBS = ("neck", "left_shoulder left_elbow", "right_shoulder right_elbow", "left_hip left_knee", "right_hip right_knee")
"""Angles that are missing together if a limb's markers are occluded, by the prefixes of their names."""
SHOWN = ("left_hip_flexion", "left_knee_flexion", "right_shoulder_flexion", "right_elbow_flexion")

Remove = Callable[[Motion, float, np.random.Generator], BoolArray]
"""Selects samples (F, 19) of a motion's joint angles to remove."""
log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ImputeGaps(WalkStudy):
    """Error of the imputed samples, by method and by fraction removed; and one imputed walk.

    fractions: of the samples removed. The walk displayed has the median error, at the middle fraction. Metrics: those
    of `gap_study` with blocks removed; with suffix _markers, with whole markers removed for half a cycle.
    """

    subjects: Sequence[str] | None = ("08", "16", "32", "35", "38")
    fractions: Sequence[float] = (0.1, 0.2, 0.3)

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Remove, impute, compare.

        Raises InputError for a fraction outside 0 to 0.9, and as `training_motions` and `gap_study` do.
        """
        if not self.fractions or not all(0.0 < fraction <= 0.9 for fraction in self.fractions):
            raise InputError(f"study: fractions must be between 0 and 0.9, found {list(self.fractions)}")
        motions, _ = cyclic(self.walks())
        fractions = sorted(self.fractions)
        blocks = gap_study(motions, fractions, rng)
        markers = gap_study(motions, fractions, rng, remove_markers)
        metrics = blocks | {f"{name}_markers": value for name, value in markers.items()}
        figures = (
            _errors("blocks removed", fractions, blocks),
            _errors("markers removed", fractions, markers),
            *_imputed_walk(motions, fractions[len(fractions) // 2], rng),
        )
        return StudyResult(metrics, figures, _note(fractions, metrics))


def gap_study(
    motions: Sequence[Motion], fractions: Sequence[float], rng: np.random.Generator, remove: Remove = remove_blocks
) -> dict[str, float]:
    """Return root mean square errors, in degrees, of the samples imputed after a fraction of them was removed.

    For every fraction, e.g. 0.1: rmse_deg_10 for `impute`, and rmse_deg_10_linear, _periodic and _paper for the others.
    Periods, alignment and models are learned from all motions with gaps together. A motion whose period is not found is
    omitted, with a warning; sequences_10 is the number of the others. Raises InputError if there are none.
    """
    measured: dict[str, float] = {}
    for fraction in tqdm(fractions, desc="gaps", disable=None):
        truths, gappy, alignment = gappy_sequences(motions, fraction, rng, remove)
        percent = round(100 * fraction)
        for method, imputed in _imputed(gappy, alignment).items():
            triples = zip(truths, gappy, imputed, strict=True)
            errors = np.concatenate([(f - truth)[np.isnan(series)] for truth, series, f in triples])
            measured[f"rmse_deg_{percent}{method}"] = float(np.rad2deg(np.sqrt(np.mean(errors**2))))
        measured[f"sequences_{percent}"] = float(len(gappy))
    return measured


def gappy_sequences(
    motions: Sequence[Motion], fraction: float, rng: np.random.Generator, remove: Remove = remove_blocks
) -> tuple[list[FloatArray], list[FloatArray], CycleAlignment]:
    """Return joint angles (F_i, 19) of motions, the same with NaN where removed, and the latter's alignment."""
    truths, gappy, periods = [], [], []
    for motion in motions:
        truth = motion.poses[:, N_ROOT:]
        try:
            series = np.where(remove(motion, fraction, rng), np.nan, truth)
            periods.append(motion_period(motion, series))
        except InputError as error:
            log.warning("%s omitted from the study of gaps: %s", motion.name, error)
            continue
        truths.append(truth)
        gappy.append(series)
    if not periods:
        raise InputError(f"gaps: expected cyclic motions, found no period in any of {len(motions)}")
    return truths, gappy, align(gappy, periods)


def remove_markers(motion: Motion, fraction: float, rng: np.random.Generator) -> BoolArray:
    """Select samples (F, 19) to remove: all angles of a limb at once, for half a cycle at a time."""
    names = POSE_NAMES[N_ROOT:]
    removed = np.zeros((len(motion), len(names)), dtype=bool)
    half = min(len(motion), round(0.5 * motion_period(motion, motion.poses[:, N_ROOT:])))
    for limb in LIMBS:
        angles = [i for i, name in enumerate(names) if name.startswith(tuple(limb.split()))]
        while removed[:, angles[0]].mean() < fraction:
            start = rng.integers(len(motion) - half + 1)
            removed[start : start + half, angles] = True
    return removed


def _imputed(gappy: Sequence[FloatArray], alignment: CycleAlignment) -> dict[str, list[FloatArray]]:
    """Return the sequences (F_i, 19) imputed by every method, by the suffix of its metrics' names."""
    return {
        "": impute(gappy, alignment),
        "_linear": impute_linear(gappy),
        "_periodic": impute_periodic(gappy, alignment),
        "_paper": impute_paper(gappy, alignment),
    }


def _errors(name: str, fractions: Sequence[float], measured: Mapping[str, float]) -> Curves:
    percents = np.array([round(100 * fraction) for fraction in fractions])
    curves = {label: np.array([measured[f"rmse_deg_{p}{end}"] for p in percents]) for end, label in LABELS.items()}
    return Curves(f"gaps/{name}", percents.astype(np.float64), curves, "percent missing", "RMSE in degrees")


def _imputed_walk(motions: Sequence[Motion], fraction: float, rng: np.random.Generator) -> list[Curves]:
    """Return curves of one walk's angles: the observed ones, and in gaps the ground truth and every method's."""
    truths, gappy, alignment = gappy_sequences(motions, fraction, rng)
    imputed = _imputed(gappy, alignment)
    squares = [np.mean((f - t)[np.isnan(g)] ** 2) for f, t, g in zip(imputed[""], truths, gappy, strict=True)]
    k = int(np.argsort(squares)[len(squares) // 2])
    motion = next(motion for motion in motions if np.array_equal(motion.poses[:, N_ROOT:], truths[k]))
    time = np.arange(len(motion)) / motion.rate_hz
    figures = []
    for name in SHOWN:
        column = angle(name)
        # with neighbours, so that a curve over a gap meets the observed ones
        gap = np.convolve(np.isnan(gappy[k][:, column]), np.ones(3), mode="same") > 0.0
        curves = {label: np.where(gap, imputed[end][k][:, column], np.nan) for end, label in LABELS.items()}
        curves |= {"truth": np.where(gap, truths[k][:, column], np.nan), "observed": gappy[k][:, column]}
        heading = f"gaps/{motion.name}, {title(name)}, {100 * fraction:.0f} % removed"
        figures.append(Curves(heading, time, degrees(curves), "time in seconds", "degrees"))
    return figures


def _note(fractions: Sequence[float], metrics: Mapping[str, float]) -> str:
    percent = round(100 * fractions[len(fractions) // 2])
    here = f"rmse_deg_{percent}"
    return (
        f"**Paper B, section 2.2.** Samples of {metrics[f'sequences_{percent}']:.0f} walks were removed in blocks of "
        f"0.1–0.5 s per angle, or all angles of a limb for half a cycle as if its markers were occluded, and imputed. "
        f"With {percent} % in blocks the error is {metrics[here]:.2f}° by our method (functional PCA with softened "
        f"singular values, plus the interpolated residual), {metrics[here + '_paper']:.2f}° by the paper's algorithm, "
        f"{metrics[here + '_periodic']:.2f}° by a periodic spline per walk, {metrics[here + '_linear']:.2f}° by linear "
        f"interpolation; with markers occluded {metrics[here + '_markers']:.2f}° by our method."
    )
