"""The person who is followed through the people detected in all views."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.assignment import Assignment, track
from workbench.datasets.association.detections import detector_view
from workbench.datasets.association.left_right import PARTS, exchanged_sides, undone
from workbench.datasets.association.track_stitching import extended_backwards, stitched, without_short
from workbench.motion.formats.openpose import LAYOUTS, People
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

Chosen = int | Mapping[str, int] | None
"""Whom to follow: a number in the first camera's first frame with anybody in it, or in those of the cameras named."""

_LONG_GAP_S = 0.5
"""Time without the person in a view above which a message reports it."""
_MIN_LOG_ODDS = np.log(20.0)
"""Log odds below which a message reports that people may have been exchanged."""


@dataclass(frozen=True, eq=False)
class Followed:
    """One person. frames: (T,) numbers of the frames, rising. joints: (V, T, J, 3) in each of the views, [u px, v px,
    confidence], left and right corrected, NaN for what was not detected. counted: how many people there are, in how
    many frames this one is not seen, and in how many arms and legs left and right were exchanged."""

    frames: IntArray
    joints: FloatArray
    counted: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class _Shown:
    """Everybody detected. names: of the V views. frames: (T,) numbers. joints: (n, J, 3) by frame and view. assigned:
    by frame whom the detections show."""

    names: Sequence[str]
    frames: IntArray
    joints: Sequence[Sequence[FloatArray]]
    assigned: Sequence[Assignment]

    def of(self, number: int) -> FloatArray:
        """Return one person's joints (V, T, J, 3)."""
        joints = np.full((len(self.names), len(self.frames), len(JOINT_NAMES), 3), np.nan)
        for t, frame in enumerate(self.assigned):
            for view, row in (place for place, who in frame.items() if who == number):
                joints[view, t] = self.joints[t][view][row]
        return joints


def follow(
    found: Mapping[str, People], cameras: Mapping[str, Camera] | None, rate_hz: float, person: Chosen = None,
    within: tuple[int, int | None] = (0, None),
) -> Followed:  # fmt: skip
    """Follow one person through frames of one rate that start together.

    Parameters
    ----------
    found : people by view; with several views a person is whom at least two of them show at once
    cameras : of all views; None for a single view
    rate_hz : frames per second
    person : None for the person in the first frame with anybody in it who is largest and most confidently detected
        over all frames and views
    within : numbers of the first frame and of the last, None for the end

    Raises
    ------
    InputError
        Where nobody is detected, and for a person whom no view, or no other view, shows.
    """
    frames = np.unique(np.concatenate([people.frames for people in found.values()]))
    frames = frames[(frames >= within[0]) & (frames <= (frames[-1] if within[1] is None else within[1]))]
    views = [detector_view(one, cameras[name] if cameras and len(found) > 1 else None) for name, one in found.items()]
    joints = [[_in_frame(people, frame) for people in found.values()] for frame in frames]
    detections = [[list(map(v.detection, shown)) for v, shown in zip(views, each, strict=True)] for each in joints]
    times_s = frames / rate_hz
    tracks = without_short(track(views, detections, times_s))
    assigned = stitched(extended_backwards(views, detections, times_s, tracks), times_s)
    shown = _Shown(list(found), frames, joints, assigned)
    own = shown.of(_chosen(shown, person))
    seen = np.asarray(np.isfinite(own[..., 0]).any(axis=2), bool)  # (V, T)
    swapped = exchanged_sides(views, own, rate_hz) & seen[..., None]
    counted = {
        "people": len({who for frame in assigned for who in frame.values()}),
        "frames_unseen": int((~seen.any(axis=0)).sum()), "swapped_sides": int(swapped.sum()),
    }  # fmt: skip
    if counted["people"] > 1:
        share = f"{100.0 * seen.any(axis=0).mean():.0f} % of {len(frames)} frames"
        log.info("%s: %d people; the one followed is seen in %s", ", ".join(found), counted["people"], share)
        unsure = tracks.log_odds[tracks.log_odds < _MIN_LOG_ODDS]
        if len(unsure):
            log.info("people may be exchanged in %d frames: odds %.1f to 1", len(unsure), np.exp(max(unsure.min(), 0)))
    _report_gaps(shown, seen, rate_hz)
    _report_joints(found, own, swapped)
    return Followed(frames, undone(own, swapped), counted)


def _in_frame(people: People, frame: int) -> FloatArray:
    """Return the joints (n, J, 3) of those detected in a frame."""
    row = int(np.searchsorted(people.frames, frame))
    there = row < len(people.frames) and people.frames[row] == frame
    return people.joints[row] if there else np.empty((0, len(JOINT_NAMES), 3))


def _chosen(shown: _Shown, person: Chosen) -> int:
    """Return the number of the person to follow."""
    first = next((frame for frame in shown.assigned if frame), None)
    if first is None:
        several = "that two cameras see at once: do the videos start together, and is the calibration theirs"
        expected = several if len(shown.names) > 1 else "in the frames used"
        raise InputError(f"{', '.join(shown.names)}: expected somebody {expected}")
    if person is None:
        return max(sorted(set(first.values())), key=lambda number: _presence(shown.of(number)))
    wanted = dict(person) if isinstance(person, Mapping) else {shown.names[0]: person}
    numbers = all(isinstance(row, int) and not isinstance(row, bool) for row in wanted.values())
    if not numbers or not wanted or not set(wanted) <= set(shown.names):
        raise InputError(
            f"person: expected a number, or numbers by some of {', '.join(shown.names)}, found {person!r}; to follow "
            "everybody, sweep over the numbers: workbench -m dataset.person=0,1"
        )
    chosen = {_numbered(shown, name, row) for name, row in wanted.items()}
    if len(chosen) > 1:
        those = ", ".join(f"{row} of {name}" for name, row in wanted.items())
        raise InputError(f"person: expected numbers of one person, found that {those} are {len(chosen)}")
    return chosen.pop()


def _numbered(shown: _Shown, name: str, row: int) -> int:
    """Return the person with a number among those detected in a view's first frame with anybody in it."""
    view = list(shown.names).index(name)
    t = next((t for t, views in enumerate(shown.joints) if np.isfinite(views[view]).any()), None)
    if t is None:
        raise InputError(f"{name}: no person {row}: nobody is found in the frames used")
    frame, n = shown.frames[t], len(shown.joints[t][view])
    if not 0 <= row < n:
        raise InputError(f"{name}: no person {row} in frame {frame}, where the first are found, expected 0 to {n - 1}")
    if (view, row) not in shown.assigned[t]:
        raise InputError(
            f"{name}: person {row} in frame {frame} cannot be followed: no other camera sees them then, or hardly "
            "a joint is found; choose them by another camera, or begin with another frame"
        )
    return shown.assigned[t][view, row]


def _presence(joints: FloatArray) -> float:
    """Return the sum of confidence times height in the image of one person's joints (V, T, J, 3)."""
    seen = joints[np.isfinite(joints[..., 0]).any(axis=2)]
    heights = (np.nanmax(seen[..., :2], axis=1) - np.nanmin(seen[..., :2], axis=1)).max(axis=1)
    return float((np.nansum(seen[..., 2], axis=1) * heights).sum())


def _report_gaps(shown: _Shown, seen: BoolArray, rate_hz: float) -> None:
    """Log the frames in which views do not show the person, by what they show (V, T)."""
    for name, there in zip(shown.names, seen, strict=True):
        for gone, run in groupby(range(len(there)), key=lambda t: not there[t]):
            gap = list(run)
            if gone and len(gap) > _LONG_GAP_S * rate_hz:
                first, last = shown.frames[gap[0]], shown.frames[gap[-1]]
                log.info("%s: the person is not found in frames %d to %d; the fit goes on without", name, first, last)


def _report_joints(found: Mapping[str, People], joints: FloatArray, swapped: BoolArray) -> None:
    """Log exchanged sides, and joints that the detectors' layouts have and no frame shows."""
    for part, number in zip(PARTS, swapped.sum(axis=(0, 1)), strict=True):
        if number:
            limbs = "arms" if "elbow" in part else "legs"
            log.info("left and right %s were exchanged in %d detections; undone", limbs, number)
    known = {name for people in found.values() for name in LAYOUTS[people.layout][1]}
    seen = np.asarray(np.isfinite(joints[..., 0]).any(axis=(0, 1)), bool)
    if never := [name for name, there in zip(JOINT_NAMES, seen, strict=True) if name in known and not there]:
        log.info("never found: %s; where they are, the body and the prior say", ", ".join(never))
