"""Evaluation of several estimates of the same trials against the truth, with intervals and paired differences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from workbench.evaluation.comparison.alignment import NONE, RIGID, ROOT, aligned, offset_s, similarity
from workbench.evaluation.comparison.joint_motion import JointMotion
from workbench.evaluation.comparison.scores import SCORES, FrameScores, frame_scores, joint_angles
from workbench.evaluation.uncertainty.intervals import bootstrap_interval
from workbench.results.evaluate.joint_files import SUFFIXES
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream
from workbench.utils.run_files import RECORDING

_LEVEL = 0.9
BLOCK_S = 1.0
"""Parts of an only trial, which take the place of trials: errors of a tracker last for some tenths of a second."""
_MIN_PARTS = 5
"""Fewer trials or parts give no interval: a bootstrap of so few is too narrow."""
_SAME_RATE, _ROUNDING_S = 1e-3, 1e-6
_CLEAR_GAIN = 0.5
"""A rigid alignment that reduces the error to this part is mentioned, as the two worlds may differ."""
_LIMITS_OF_AGREEMENT = 1.96
"""Standard deviations (Bland & Altman, *Lancet* 327, 1986)."""


@dataclass(frozen=True, eq=False)
class Compared:
    """An estimate of one trial and the truth, aligned, with equal joints and times; the scores of their frames; and
    what a user has to know of the comparison, as sentences."""

    trial: str
    estimate: JointMotion
    truth: JointMotion
    scores: FrameScores
    notes: tuple[str, ...]


def compared(trial: str, estimate: JointMotion, truth: JointMotion, align: str, offset: float | None) -> Compared:
    """Return an estimate of a trial compared with the truth.

    Joints are matched by name. The motion with more frames a second is interpolated at the times of the other. Of a
    motion without joints, only angles are compared, and the offset is not estimated.

    Parameters
    ----------
    align : one of ALIGNMENTS.
    offset : s, added to the estimate's clock; None: estimated, see `offset_s`.

    Raises
    ------
    InputError : fewer than two joints, or no frame, in common, or no pelvis or hips for ROOT.
    """
    if not (estimate.names and truth.names):
        return _compared_angles(trial, estimate, truth, offset)
    names = [name for name in truth.names if name in estimate.names]
    if len(names) < 2:
        raise InputError(
            f"{estimate.source}: expected joints of {truth.source}, {', '.join(truth.names)}; found "
            f"{', '.join(estimate.names)}"
        )
    if align == ROOT and "pelvis" not in names:
        raise InputError(f"{estimate.source}: --align root needs the pelvis or both hips in both files")
    own, true = estimate.of_joints(names), truth.of_joints(names)
    added_s = offset_s(own, true) if offset is None else offset
    own = replace(own, times_s=own.times_s + added_s)
    times_s = _common_times(own, true)
    own, true = own.at(times_s), true.at(times_s)
    if not np.isfinite(true.positions + own.positions).any():
        raise InputError(
            f"{estimate.source}: no joint is known at the same time in {truth.source}; {_span(estimate, added_s)} "
            f"against {_span(truth, 0.0)}"
        )
    places, true_places, samples = aligned(own, true, align)
    scores = frame_scores(names, times_s, places, true_places, samples)
    notes = _notes(estimate, truth, names, added_s, offset is None, align, own, true)
    own, true = replace(own, positions=places, samples=samples), replace(true, positions=true_places)
    return Compared(trial, own, true, scores, notes)


def _compared_angles(trial: str, estimate: JointMotion, truth: JointMotion, offset: float | None) -> Compared:
    """Return the comparison of the angles that both motions have, which the joints of one may determine."""
    own, true = (
        each if each.angles_deg else replace(each, angles_deg=joint_angles(each.names, each.positions))
        for each in (estimate, truth)
    )
    names = [name for name in true.angles_deg if name in own.angles_deg]
    own = replace(own, times_s=own.times_s + (offset or 0.0))
    times_s = _common_times(own, true)
    if not names or not len(times_s):
        raise InputError(
            f"{estimate.source}: expected angles of {truth.source} at the same times: {', '.join(true.angles_deg)}, "
            f"{_span(truth, 0.0)}; found {', '.join(own.angles_deg) or 'none'}, {_span(estimate, offset or 0.0)}"
        )
    own, true = own.at(times_s), true.at(times_s)
    pairs = {}
    for name in names:
        errors = own.angles_deg[name] - true.angles_deg[name]
        errors -= 360.0 * np.round(errors / 360.0)  # a whole turn is none
        pairs[name] = (true.angles_deg[name] + errors, true.angles_deg[name])
    note = f"{estimate.source}: {len(names)} angles in {len(times_s)} frames, as a file has no joints"
    scores = FrameScores({}, np.empty((len(times_s), 0)), pairs)
    return Compared(trial, own.of_joints(()), true.of_joints(()), scores, (note,))


def _common_times(estimate: JointMotion, truth: JointMotion) -> FloatArray:
    """Return the times (F,), s, of the motion with fewer frames a second, within the span of the other."""
    slower, other = estimate, truth
    if estimate.interval_s < truth.interval_s * (1.0 - _SAME_RATE):
        slower, other = truth, estimate
    inside = (slower.times_s >= other.times_s[0] - _ROUNDING_S) & (slower.times_s <= other.times_s[-1] + _ROUNDING_S)
    return slower.times_s[inside]


def _span(motion: JointMotion, added_s: float) -> str:
    return f"{motion.times_s[0] + added_s:.3f} to {motion.times_s[-1] + added_s:.3f} s"


def _notes(
    estimate: JointMotion, truth: JointMotion, names: Sequence[str], added_s: float, estimated: bool, align: str,
    own: JointMotion, true: JointMotion,
) -> tuple[str, ...]:  # fmt: skip
    """Return what a user has to know of a comparison, as sentences."""
    place, notes = estimate.source, []
    missing = [name for name in truth.names if name not in names]
    rates = [f"{1.0 / each.interval_s:.4g} Hz" for each in (estimate, truth)]
    notes.append(
        f"{place}: {len(names)} joints in {len(own.times_s)} frames of {rates[0]}, truth {rates[1]}"
        + (f"; without {', '.join(missing)}" if missing else "")
    )
    if added_s and estimated:
        notes.append(f"{place}: its clock is {added_s:+.3f} s from the truth's, by the motion; --offset 0 ignores it")
    if align != NONE or (transform := similarity(own.positions, true.positions, scaled=False)) is None:
        return tuple(notes)
    as_it_is, moved = (
        float(np.nanmean(np.linalg.norm(each - true.positions, axis=-1)))
        for each in (own.positions, transform(own.positions))
    )
    if moved < _CLEAR_GAIN * as_it_is:
        known = own.positions[np.isfinite(own.positions).all(axis=-1)]
        shift_m = float(np.linalg.norm(transform(known) - known, axis=-1).mean())
        notes.append(
            f"{place}: {1e3 * as_it_is:.0f} mm from the truth, and {1e3 * moved:.0f} mm after turning the whole motion "
            f"by {transform.angle_deg:.0f}° and moving it by {shift_m:.2f} m, as --align {RIGID} does"
        )
    return tuple(notes)


def score_table(estimates: Mapping[str, Sequence[Compared]]) -> pd.DataFrame:
    """Return a row for each score and estimate, and for each difference of an estimate from the first one.

    Columns: score, unit, estimate, value, low_90, high_90, n. The intervals are of a bootstrap over trials, or over
    parts of BLOCK_S of an only trial, n of them; they are NaN for fewer than _MIN_PARTS. Differences are paired.
    """
    rows, first = [], next(iter(estimates))
    for score, (title, unit, _) in SCORES.items():
        values = {name: pd.Series(_values(each, score)) for name, each in estimates.items()}
        others = {name: each for name, each in values.items() if name != first}
        values |= {f"{name} − {first}": each.sub(values[first]).dropna() for name, each in others.items()}
        rows += [(score, title, unit, name, *_mean_and_interval(each)) for name, each in values.items()]
    table = pd.DataFrame(rows, columns=["score", "title", "unit", "estimate", "value", "low_90", "high_90", "n"])
    return table[table["n"] > 0].reset_index(drop=True)


def _values(trials: Sequence[Compared], score: str) -> dict[str, float]:
    """Return the mean score of each trial, or of each part of an only trial, by its name; without unknown ones."""
    values = {}
    for trial in trials:
        frames = trial.scores.scores.get(score)
        if frames is None:
            continue
        parts = _parts(trial.truth.times_s) if len(trials) == 1 else np.zeros(len(frames))
        for part in np.unique(parts[np.isfinite(frames)]):
            values[f"{trial.trial} {part:g}"] = float(np.nanmean(frames[parts == part]))
    return values


def _parts(times_s: FloatArray) -> FloatArray:
    """Return the numbers (F,) of the parts of a trial, of equal length, about BLOCK_S, in which times (F,) are."""
    since_s = times_s - times_s[0]
    span_s = float(since_s[-1]) + float(np.median(np.diff(times_s))) if len(times_s) > 1 else BLOCK_S
    return np.asarray(np.floor(since_s / span_s * max(round(span_s / BLOCK_S), 1)))


def _mean_and_interval(values: "pd.Series[float]") -> tuple[float, float, float, int]:
    if len(values) == 0:
        return np.nan, np.nan, np.nan, 0
    numbers = values.to_numpy(dtype=float)
    low, high = (
        bootstrap_interval(numbers, stream(0, "bootstrap"), _LEVEL) if len(numbers) >= _MIN_PARTS else (np.nan, np.nan)
    )
    return float(numbers.mean()), float(low), float(high), len(numbers)


def joint_table(estimates: Mapping[str, Sequence[Compared]]) -> pd.DataFrame:
    """Return the mean error of each joint, mm, with a column for each estimate."""
    columns = {}
    for name, trials in estimates.items():
        means: dict[str, list[FloatArray]] = {}
        for trial in trials:
            for joint, distances in zip(trial.truth.names, trial.scores.distances_mm.T, strict=True):
                means.setdefault(joint, []).append(distances[np.isfinite(distances)])
        columns[name] = {
            joint: float(np.concatenate(each).mean()) for joint, each in means.items() if sum(map(len, each))
        }
    return pd.DataFrame(columns).rename_axis("joint").reset_index()


def angle_table(estimates: Mapping[str, Sequence[Compared]]) -> pd.DataFrame:
    """Return for each angle and estimate the root mean square error, the bias, and the limits of agreement, degrees."""
    rows = []
    for name, trials in estimates.items():
        for angle in dict.fromkeys(angle for trial in trials for angle in trial.scores.angles_deg):
            pairs = [trial.scores.angles_deg[angle] for trial in trials if angle in trial.scores.angles_deg]
            errors = np.concatenate([own - true for own, true in pairs])
            errors = errors[np.isfinite(errors)]
            if len(errors):
                bias, reach = float(errors.mean()), _LIMITS_OF_AGREEMENT * float(errors.std())
                rms = float(np.sqrt(np.square(errors).mean()))
                rows.append((angle, name, rms, bias, bias - reach, bias + reach))
    return pd.DataFrame(rows, columns=["angle", "estimate", "rmse_deg", "bias_deg", "loa_low_deg", "loa_high_deg"])


def trials_of(estimate: Path, truth: Path) -> list[tuple[str, Path, Path]]:
    """Return the name, the file of the estimate and that of the truth of each trial: one of two files, or those of
    equal names, but for the extension, in two folders.

    Raises InputError for a folder against a file, a folder without motions, and a trial without an estimate.
    """
    if _is_trial(truth):
        if not _is_trial(estimate):
            raise InputError(f"{estimate}: expected a file, as the truth is one, {truth}")
        return [(truth.stem, estimate, truth)]
    true, own = _named(truth), _named(estimate)
    if not true:
        raise InputError(f"{truth}: expected motions, {', '.join(SUFFIXES)}, found none in this folder")
    if missing := [name for name in true if name not in own]:
        raise InputError(
            f"{estimate}: expected an estimate of the trial {missing[0]}, found {', '.join(own) or 'none'}"
        )
    return [(name, own[name], path) for name, path in true.items()]


def _is_trial(path: Path) -> bool:
    return not path.is_dir() or (path / RECORDING).is_file()


def _named(folder: Path) -> dict[str, Path]:
    """Return the motions in a folder, and the runs in its folders, by name."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder, as the truth is one")
    return {
        path.stem: path
        for path in sorted(folder.iterdir())
        if path.name.lower().endswith(SUFFIXES) or (path / RECORDING).is_file()
    }
