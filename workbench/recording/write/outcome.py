"""Records of a run's end: the verdict, lanes of states over time, reprojection errors."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.evaluation.verdict.run_measurements import RunMeasurements, stance
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.recording.write import styles
from workbench.recording.write.columns import nanoseconds, time_index
from workbench.utils.arrays import FloatArray
from workbench.utils.finding import LEVELS
from workbench.utils.nan_statistics import nan_mean

VERDICT, STATE, REPROJECTION_ERRORS = "verdict", "state", "reprojection_error_px"
_GREEN, _RED, _GREY, _BLUE, _AMBER = (60, 150, 80), (205, 75, 60), (120, 120, 120), (60, 120, 190), (215, 150, 40)
_COLOURS = {"tracked": _GREEN, "none": _GREEN, "stance": _BLUE, "not known": _GREY, "not seen": _GREY,
            "lost": _RED}  # fmt: skip
"""Colours of states; any other, such as doubtful, is amber."""
_HIDDEN = ("swing", "no gait")
_FOREARM = "forearm"


def verdict_text(message: str = "") -> rr.TextDocument:
    """Return the verdict as text with its level in bold; "": of a run without a verdict."""
    level = next((each for each in LEVELS if message.startswith(each)), "")
    text = f"**{level}**{message.removeprefix(level)}" if message else "no verdict: the run is running, or was cut off"
    return rr.TextDocument(text, media_type="text/markdown")


def log_lanes(stream: rr.RecordingStream, verdict: Verdict, measured: RunMeasurements) -> tuple[str, ...]:
    """Log the changes of states over frames and times, and return the names of the lanes."""
    lanes = {name: states for name, states in _lanes(verdict, measured).items() if any(states)}
    for name, states in lanes.items():
        path, valid = f"{STATE}/{name}", [(k, state) for k, state in enumerate(states) if state]
        changes = [now for before, now in zip([(-1, ""), *valid], valid, strict=False) if now[1] != before[1]]
        rows = [k for k, _ in changes]
        index = time_index(measured.frames[rows], map(nanoseconds, measured.times_s[rows]))
        stream.send_columns(path, indexes=index, columns=rr.StateChange.columns(state=[state for _, state in changes]))
        values = list(dict.fromkeys(state for _, state in valid))
        shades, visible = [_COLOURS.get(state, _AMBER) for state in values], [state not in _HIDDEN for state in values]
        stream.log(path, rr.StateConfiguration(values=values, colors=shades, visible=visible), static=True)
    return tuple(lanes)


def _lanes(verdict: Verdict, measured: RunMeasurements) -> Mapping[str, Sequence[str]]:
    """Return the states over frames by lane."""
    uncertain = [", ".join(groups) or "none" for groups in measured.uncertain_groups]
    places = measured.pelvis_and_ankles
    stances = stance(places[:, 0], places[:, 1:], measured.times_s[: len(places)])
    words = np.where(np.isnan(stances), "no gait", np.where(stances == 1.0, "stance", "swing")).T.tolist()
    return {
        "tracking": verdict.states,
        **verdict.joint_states,
        "large_expected_error": uncertain if set(uncertain) != {"none"} else [],
        **(dict(zip(("foot_left", "foot_right"), words, strict=True)) if (stances == 1.0).any() else {}),
    }


def reprojection_errors(measured: RunMeasurements) -> dict[str, FloatArray]:
    """Return reprojection errors (F,), px, by camera, and a forearm's width in the image; {} without keypoints."""
    valid = [v for v in range(len(measured.cameras)) if np.isfinite(measured.keypoint_error_px[:, v]).any()]
    if not valid:
        return {}
    heights = np.where(measured.person_height_px > 0.0, measured.person_height_px, np.nan)[:, valid]
    errors = {measured.cameras[v]: measured.keypoint_error_px[:, v] for v in valid}
    return errors | {_FOREARM: FOREARM_OVER_HEIGHT * nan_mean(heights)}


def log_reprojection_errors(stream: rr.RecordingStream, measured: RunMeasurements) -> tuple[str, ...]:
    """Log the reprojection errors over frames and times, and return their entity paths.

    They are drawn as points where fewer than half of the frames have any.
    """
    paths = []
    for k, (name, values) in enumerate(reprojection_errors(measured).items()):
        path, valid = f"{REPROJECTION_ERRORS}/{name}", np.isfinite(values)
        if not valid.any():
            continue
        style = styles.FOREARM if name == _FOREARM else (name, styles.SERIES[k % len(styles.SERIES)], 1.5)
        stream.log(path, (styles.line if valid.mean() >= 0.5 else styles.dots)(*style), static=True)
        index = time_index(measured.frames[valid], map(nanoseconds, measured.times_s[valid]))
        stream.send_columns(path, indexes=index, columns=rr.Scalars.columns(scalars=values[valid]))
        paths.append(path)
    return tuple(paths)
