"""Who was there before two views showed them at once: what a pass backwards in time adds where tracks begin."""

from collections.abc import Sequence

import numpy as np

from workbench.datasets.association.detections import Detection, Eye
from workbench.datasets.association.multi_hypothesis import GAP_S, Assigned, Tracked, track
from workbench.utils.arrays import FloatArray


def backdated(
    eyes: Sequence[Eye], frames: Sequence[Sequence[Sequence[Detection]]], times_s: FloatArray, tracked: Tracked
) -> Tracked:
    """Return tracks that begin as early as detections of nobody go on backwards from where each began.

    Backwards in time, who is one person where a track begins is followed up to who is somebody else forwards.
    """
    births = _births(tracked)
    late = [t for t in births.values() if _free(frames, tracked.assigned, t)]
    if not late:
        return tracked
    n = int(np.searchsorted(times_s, times_s[max(late)] + GAP_S, side="right"))
    back = track(eyes, frames[:n][::-1], times_s[n - 1] - times_s[:n][::-1])
    assigned, joints = [dict(one) for one in tracked.assigned], [dict(one) for one in tracked.joints]
    for number, birth in births.items():
        there = back.assigned[n - 1 - birth] if birth < n else {}
        same = {there[place] for place, who in tracked.assigned[birth].items() if who == number and place in there}
        if len(same) != 1:
            continue
        (other,) = same
        for t in range(birth - 1, -1, -1):
            own = [place for place, who in back.assigned[n - 1 - t].items() if who == other]
            if any(place in assigned[t] for place in own) or other not in back.joints[n - 1 - t]:
                break
            if own:
                assigned[t] |= dict.fromkeys(own, number)
                joints[t][number] = back.joints[n - 1 - t][other]
    return Tracked(tuple(assigned), tuple(joints), tracked.rival)


def _births(tracked: Tracked) -> dict[int, int]:
    """Return the frames in which people are first seen, by number, the earliest first."""
    births = dict[int, int]()
    for t, frame in enumerate(tracked.assigned):
        for number in sorted(frame.values()):
            births.setdefault(number, t)
    return births


def _free(frames: Sequence[Sequence[Sequence[Detection]]], assigned: Sequence[Assigned], birth: int) -> bool:
    """Tell whether some detection in the frame before is nobody's, or no view shows anybody there."""
    if birth == 0:
        return False
    n_found = sum(map(len, frames[birth - 1]))
    return n_found == 0 or len(assigned[birth - 1]) < n_found
