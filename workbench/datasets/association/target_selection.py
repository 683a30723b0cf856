"""The person who is followed through what detectors found in all views, from one of them or many."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.backward_pass import backdated
from workbench.datasets.association.detections import Detection, Eye, eye_of
from workbench.datasets.association.left_right import PARTS, exchanged_sides, undone
from workbench.datasets.association.multi_hypothesis import Assigned, track
from workbench.datasets.association.track_stitching import rejoined
from workbench.motion.formats.openpose import LAYOUTS, People
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

Chosen = int | Mapping[str, int] | None
"""Whom to follow: a number in the first camera's first frame with anybody in it, or in those of the cameras named."""

LONG_GAP_S = 0.5
"""Time without the person in a view after which a sentence says so."""


@dataclass(frozen=True, eq=False)
class Followed:
    """One person. frames: (T,) numbers of the frames, rising. joints: (V, T, J, 3) in each of the views, [u px, v px,
    confidence], left and right as they are, NaN for what was not found. counted: how many people there are, in how many
    frames this one is not seen, and in how many arms and legs left and right were exchanged."""

    frames: IntArray
    joints: FloatArray
    counted: Mapping[str, int]


def follow(
    found: Mapping[str, People], cameras: Mapping[str, Camera] | None, rate_hz: float, person: Chosen = None,
    within: tuple[int, int | None] = (0, None),
) -> Followed:  # fmt: skip
    """Follow one person through frames of one rate that start together.

    found: by view. cameras: those of all views; None for a single view. person: None for the one of those in the first
    frame that shows anybody who is seen largest and surest in all frames and views. within: numbers of the first frame
    and of the last, None for the end. With several views a person is who at least two of them show at once.
    Raises InputError where nobody is there, and for a person whom nobody, or nobody else, sees.
    """
    frames = np.unique(np.concatenate([people.frames for people in found.values()]))
    frames = frames[(frames >= within[0]) & (frames <= (frames[-1] if within[1] is None else within[1]))]
    eyes = [eye_of(people, cameras[name] if cameras and len(found) > 1 else None) for name, people in found.items()]
    shown = [[_in_frame(people, frame) for people in found.values()] for frame in frames]  # (n, J, 3) each
    detections, times_s = [_detections(eyes, views) for views in shown], frames / rate_hz
    tracked = backdated(eyes, detections, times_s, track(eyes, detections, times_s))
    assigned = rejoined(tracked, times_s)
    n_people = len({who for frame in assigned for who in frame.values()})
    number = _chosen(list(found), shown, frames, assigned, person)
    joints = _joints_of(number, shown, assigned)
    swapped = exchanged_sides(eyes, joints, rate_hz)
    seen = np.asarray(np.isfinite(joints[..., 0]).any(axis=2), bool)  # (V, T)
    swapped &= seen[..., None]
    counted = {"people": n_people, "frames_unseen": int((~seen.any(axis=0)).sum()), "swapped_sides": int(swapped.sum())}
    _tell(list(found), frames, seen, swapped, n_people, tracked.rival, rate_hz)
    _tell_unseen_joints(found, joints)
    return Followed(frames, undone(joints, swapped), counted)


def _in_frame(people: People, frame: int) -> FloatArray:
    """Return the joints (n, J, 3) of those found in a frame."""
    row = int(np.searchsorted(people.frames, frame))
    there = row < len(people.frames) and people.frames[row] == frame
    return people.joints[row] if there else np.empty((0, len(JOINT_NAMES), 3))


def _detections(eyes: Sequence[Eye], views: Sequence[FloatArray]) -> list[list[Detection]]:
    return [[eye.detection(one) for one in view] for eye, view in zip(eyes, views, strict=True)]


def _joints_of(number: int, shown: Sequence[Sequence[FloatArray]], assigned: Sequence[Assigned]) -> FloatArray:
    """Return one person's joints (V, T, J, 3)."""
    joints = np.full((len(shown[0]), len(shown), len(JOINT_NAMES), 3), np.nan)
    for t, frame in enumerate(assigned):
        for (view, row), who in frame.items():
            if who == number:
                joints[view, t] = shown[t][view][row]
    return joints


def _chosen(
    names: Sequence[str], shown: Sequence[Sequence[FloatArray]], frames: IntArray, assigned: Sequence[Assigned],
    person: Chosen,
) -> int:  # fmt: skip
    """Return the number of the person to follow."""
    if not any(frame for frame in assigned):
        several = "that two cameras see at once: do the videos start together, and is the calibration theirs"
        raise InputError(f"{', '.join(names)}: expected somebody {several if len(names) > 1 else 'in the frames used'}")
    if person is None:
        first = next(frame for frame in assigned if frame)
        return max(sorted(set(first.values())), key=lambda who: _presence(who, shown, assigned))
    wanted = _wanted(names, person)
    chosen = {_numbered(name, names.index(name), row, shown, frames, assigned) for name, row in wanted.items()}
    if len(chosen) > 1:
        those = ", ".join(f"{row} of {name}" for name, row in wanted.items())
        raise InputError(f"person: expected numbers of one person, found that {those} are {len(chosen)}")
    return chosen.pop()


def _wanted(names: Sequence[str], person: int | Mapping[str, int]) -> Mapping[str, int]:
    """Return who is wanted, as numbers by view."""
    wanted = dict(person) if isinstance(person, Mapping) else {names[0]: person}
    whole = all(isinstance(row, int) and not isinstance(row, bool) for row in wanted.values())
    if not whole or not wanted or not set(wanted) <= set(names):
        raise InputError(
            f"person: expected a number, or numbers by some of {', '.join(names)}, found {person!r}; to follow "
            "everybody, sweep over the numbers: workbench run -m dataset.person=0,1"
        )
    return wanted


def _numbered(
    name: str,
    view: int,
    row: int,
    shown: Sequence[Sequence[FloatArray]],
    frames: IntArray,
    assigned: Sequence[Assigned],
) -> int:
    """Return who has a number among those found in a view's first frame with anybody in it."""
    t = next((t for t, views in enumerate(shown) if np.isfinite(views[view]).any()), None)
    if t is None:
        raise InputError(f"{name}: no person {row}: nobody is found in the frames used")
    if not 0 <= row < len(shown[t][view]):
        some = f"0 to {len(shown[t][view]) - 1}"
        raise InputError(f"{name}: no person {row} in frame {frames[t]}, where the first are found, expected {some}")
    if (view, row) not in assigned[t]:
        raise InputError(
            f"{name}: person {row} in frame {frames[t]} cannot be followed: no other camera sees them then, or hardly "
            "a joint is found; choose them by another camera, or begin with another frame"
        )
    return assigned[t][view, row]


def _presence(who: int, shown: Sequence[Sequence[FloatArray]], assigned: Sequence[Assigned]) -> float:
    """Measure how large and sure somebody is seen: confidences times height in the image, over all views and frames."""
    presence = 0.0
    for t, frame in enumerate(assigned):
        for (view, row), number in frame.items():
            joints = shown[t][view][row]
            if number == who:
                height = np.max(np.nanmax(joints[:, :2], axis=0) - np.nanmin(joints[:, :2], axis=0))
                presence += float(np.nansum(joints[:, 2]) * height)
    return presence


def _tell(
    names: Sequence[str], frames: IntArray, seen: BoolArray, swapped: BoolArray, n_people: int, rival: float,
    rate_hz: float,
) -> None:  # fmt: skip
    """Say in the log who is followed, and what is not seen or was put right."""
    share = f"{100.0 * seen.any(axis=0).mean():.0f} % of {len(frames)} frames"
    if n_people > 1:
        log.info("%s: %d people; the one followed is seen in %s", ", ".join(names), n_people, share)
    for name, there in zip(names, seen, strict=True):
        for gone, run in groupby(range(len(frames)), key=lambda t: not there[t]):
            gap = list(run)
            if gone and len(gap) > LONG_GAP_S * rate_hz:
                first, last = frames[gap[0]], frames[gap[-1]]
                log.info("%s: the person is not found in frames %d to %d; the fit goes on without", name, first, last)
    for part, number in zip(PARTS, swapped.sum(axis=(0, 1)), strict=True):
        if number:
            limbs = "arms" if "elbow" in part else "legs"
            log.info("left and right %s were exchanged in %d detections; undone", limbs, number)
    if rival > -np.log(20.0):
        log.info("who is who in the last frames is not certain: odds %.1f to 1", np.exp(-rival))


def _tell_unseen_joints(found: Mapping[str, People], joints: FloatArray) -> None:
    known = {name for people in found.values() for name in LAYOUTS[people.layout][1]}
    seen = np.asarray(np.isfinite(joints[..., 0]).any(axis=(0, 1)), bool)
    if never := [name for name, there in zip(JOINT_NAMES, seen, strict=True) if name in known and not there]:
        log.info("never found: %s; where they are, the body and the prior say", ", ".join(never))
