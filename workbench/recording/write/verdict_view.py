"""The verdict at the top of the page, and lanes of states over time: held or lost, and what is not to be trusted."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.evaluation.evidence import Measured
from workbench.evaluation.verdict import Verdict
from workbench.recording.write.columns import Entities

VERDICT, STATE = "verdict", "state"
TRUSTED = "trusted"


def running() -> Entities:
    """Yield what the page says while nothing is known yet."""
    yield VERDICT, rr.TextDocument("the run goes on, or was cut off: no verdict yet", media_type="text/markdown")


def told(verdict: Verdict) -> Entities:
    """Yield the verdict, its first words in bold."""
    first, _, rest = verdict.sentence.partition(":")
    yield VERDICT, rr.TextDocument(f"**{first}**:{rest}", media_type="text/markdown")


def log_lanes(stream: rr.RecordingStream, verdict: Verdict, measured: Measured) -> bool:
    """Log where states change, in frames and times; tells whether there are any."""
    doubts = [", ".join(groups) or TRUSTED for groups in measured.doubted]
    lanes = {"person": list(verdict.states), "do not trust": doubts if set(doubts) != {TRUSTED} else []}
    for name, states in lanes.items():
        before = ""
        for frame, time_s, state in zip(measured.frames, measured.times_s, states, strict=False):
            if state and state != before:
                stream.set_time("frame", sequence=int(frame))
                stream.set_time("time", duration=np.timedelta64(round(time_s * 1e9), "ns"))
                stream.log(f"{STATE}/{name.replace(' ', '_')}", rr.StateChange(state=state))
                before = state
    return any(any(states) for states in lanes.values())


def view() -> rrb.TextDocumentView:
    """Lay out the verdict."""
    return rrb.TextDocumentView(origin=f"/{VERDICT}", name="verdict")


def lanes() -> rrb.StateTimelineView:
    """Lay out the states."""
    return rrb.StateTimelineView(origin=f"/{STATE}", name="states: held or lost; joints not to trust")
