"""What became of a run, recorded at its end: the verdict, lanes of states over time, residuals from the keypoints."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from workbench.evaluation.run_measurements import RunMeasurements, stance
from workbench.evaluation.verdict import FOREARM_OVER_HEIGHT, Verdict
from workbench.recording.write import styles
from workbench.recording.write.columns import nanoseconds, time_index
from workbench.utils.arrays import FloatArray

VERDICT, STATE, REPROJECTION_ERRORS = "verdict", "state", "reprojection_error_px"
_GREEN, _RED, _GREY, _BLUE = (60, 150, 80), (205, 75, 60), (120, 120, 120), (60, 120, 190)
_COLOURS = {"tracked": _GREEN, "none": _GREEN, "stance": _BLUE, "not known": _GREY}  # any other state is red
_HIDDEN = ("swing", "no gait")
_FOREARM = "forearm"


def verdict_text(sentence: str = "") -> rr.TextDocument:
    """Return the text at the top of the page, its first words in bold; "": of a run without a verdict."""
    first, _, rest = sentence.partition(":")
    text = f"**{first}**:{rest}" if sentence else "the run goes on, or was cut off: no verdict yet"
    return rr.TextDocument(text, media_type="text/markdown")


def log_lanes(stream: rr.RecordingStream, verdict: Verdict, measured: RunMeasurements) -> tuple[str, ...]:
    """Log where states change, in frames and times; returns the lanes that there are."""
    lanes = {name: states for name, states in _lanes(verdict, measured).items() if any(states)}
    for name, states in lanes.items():
        path, known = f"{STATE}/{name}", [(k, state) for k, state in enumerate(states) if state]
        changes = [now for before, now in zip([(-1, ""), *known], known, strict=False) if now[1] != before[1]]
        rows = [k for k, _ in changes]
        index = time_index(measured.frames[rows], map(nanoseconds, measured.times_s[rows]))
        stream.send_columns(path, indexes=index, columns=rr.StateChange.columns(state=[state for _, state in changes]))
        values = list(dict.fromkeys(state for _, state in known))
        shades, seen = [_COLOURS.get(state, _RED) for state in values], [state not in _HIDDEN for state in values]
        stream.log(path, rr.StateConfiguration(values=values, colors=shades, visible=seen), static=True)
    return tuple(lanes)


def _lanes(verdict: Verdict, measured: RunMeasurements) -> Mapping[str, Sequence[str]]:
    uncertain = [", ".join(groups) or "none" for groups in measured.uncertain_groups]
    feet = measured.pelvis_and_ankles
    stands = stance(feet[:, 0], feet[:, 1:], measured.times_s[: len(feet)])
    words = np.where(np.isnan(stands), "no gait", np.where(stands == 1.0, "stance", "swing")).T.tolist()
    return {
        "tracking": verdict.states,
        "large_expected_error": uncertain if set(uncertain) != {"none"} else [],
        **(dict(zip(("foot_left", "foot_right"), words, strict=True)) if (stands == 1.0).any() else {}),
    }


def residuals(measured: RunMeasurements) -> dict[str, FloatArray]:
    """Return by camera (F,), px, NaN where it has none, and a forearm's width in the image; {} where none is known."""
    known = [v for v in range(len(measured.cameras)) if np.isfinite(measured.keypoint_error_px[:, v]).any()]
    if not known:
        return {}
    heights = np.where(measured.person_height_px > 0.0, measured.person_height_px, np.nan)[:, known]
    counts = np.isfinite(heights).sum(axis=1)
    mean = np.where(counts > 0, np.nansum(heights, axis=1) / np.maximum(counts, 1), np.nan)
    return {measured.cameras[v]: measured.keypoint_error_px[:, v] for v in known} | {
        _FOREARM: FOREARM_OVER_HEIGHT * mean
    }


def log_residuals(stream: rr.RecordingStream, measured: RunMeasurements) -> dict[str, tuple[float, float]]:
    """Log the residuals over frames and times, as marks where fewer than half of the frames have any; returns the
    spans of their values by entity path."""
    spans = {}
    for k, (name, values) in enumerate(residuals(measured).items()):
        path, known = f"{REPROJECTION_ERRORS}/{name}", np.isfinite(values)
        if not known.any():
            continue
        style = styles.FOREARM if name == _FOREARM else (name, styles.SERIES[k % len(styles.SERIES)], 1.5)
        stream.log(path, (styles.line if known.mean() >= 0.5 else styles.dots)(*style), static=True)
        index = time_index(measured.frames[known], map(nanoseconds, measured.times_s[known]))
        stream.send_columns(path, indexes=index, columns=rr.Scalars.columns(scalars=values[known]))
        spans[path] = (float(values[known].min()), float(values[known].max()))
    return spans
