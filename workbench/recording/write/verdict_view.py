"""The verdict at the top of the page, and lanes of states over time: held or lost, what is not to be trusted, and which
foot stands."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.evaluation.evidence import RunMeasurements, stance
from workbench.evaluation.verdict import Verdict
from workbench.recording.write.columns import Entities

VERDICT, STATE = "verdict", "state"
TRUSTED = "trusted"
STANDS, SWINGS, NO_GAIT = "stands", "swings", "no gait"
_GREEN, _RED, _GREY, _BLUE = (60, 150, 80), (205, 75, 60), (120, 120, 120), (60, 120, 190)
_COLOURS = {"held": _GREEN, "lost": _RED, "not known": _GREY, TRUSTED: _GREEN, STANDS: _BLUE}
_TOLD = {
    "person": "held or lost", "do_not_trust": "what not to trust", "foot_left": "feet that stand",
    "foot_right": "feet that stand",
}  # fmt: skip
_HIDDEN = (SWINGS, NO_GAIT)


def running() -> Entities:
    """Yield what the page says while nothing is known yet."""
    yield VERDICT, rr.TextDocument("the run goes on, or was cut off: no verdict yet", media_type="text/markdown")


def told(verdict: Verdict) -> Entities:
    """Yield the verdict, its first words in bold."""
    first, _, rest = verdict.sentence.partition(":")
    yield VERDICT, rr.TextDocument(f"**{first}**:{rest}", media_type="text/markdown")


def log_lanes(stream: rr.RecordingStream, verdict: Verdict, measured: RunMeasurements) -> tuple[str, ...]:
    """Log where states change, in frames and times; returns the lanes that there are."""
    lanes = {name: states for name, states in _lanes(verdict, measured).items() if any(states)}
    for name, states in lanes.items():
        path, before = f"{STATE}/{name}", ""
        for frame, time_s, state in zip(measured.frames, measured.times_s, states, strict=False):
            if state and state != before:
                stream.set_time("frame", sequence=int(frame))
                stream.set_time("time", duration=np.timedelta64(round(time_s * 1e9), "ns"))
                stream.log(path, rr.StateChange(state=state))
                before = state
        values = list(dict.fromkeys(state for state in states if state))
        shades, seen = [_COLOURS.get(state, _RED) for state in values], [state not in _HIDDEN for state in values]
        stream.log(path, rr.StateConfiguration(values=values, colors=shades, visible=seen), static=True)
    return tuple(lanes)


def _lanes(verdict: Verdict, measured: RunMeasurements) -> dict[str, Sequence[str]]:
    doubts = [", ".join(groups) or TRUSTED for groups in measured.doubted]
    lanes: dict[str, Sequence[str]] = {
        "person": verdict.states,
        "do_not_trust": doubts if set(doubts) != {TRUSTED} else [],
    }
    feet = measured.feet
    stands = stance(feet[:, 0], feet[:, 1:], measured.times_s[: len(feet)])
    if (stands == 1.0).any():
        for k, side in enumerate(("left", "right")):
            words = [NO_GAIT if np.isnan(each) else STANDS if each else SWINGS for each in stands[:, k]]
            lanes[f"foot_{side}"] = words
    return lanes


def view() -> rrb.TextDocumentView:
    """Lay out the verdict."""
    return rrb.TextDocumentView(origin=f"/{VERDICT}", name="verdict")


def lanes(names: Sequence[str]) -> rrb.StateTimelineView:
    """Lay out the states."""
    told = dict.fromkeys(_TOLD[name] for name in names)
    return rrb.StateTimelineView(origin=f"/{STATE}", name=f"states: {', '.join(told)}")
