"""People detected in videos, with the points of any detector's layout as joints."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workbench.detections.readers.detected_points import DetectedPoints
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.keypoint_files import read_points
from workbench.detections.readers.layout_by_anatomy import CLEAR, check_layout, matching_layout
from workbench.detections.readers.named_points import joints_of_points, layout_joints, named_points
from workbench.detections.readers.pairing import paired_frames
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

MAX_PEOPLE = 40
"""People in a frame, since the association over time considers all pairs of frames' people and several hypotheses:
100 who overlap take 12 s a frame."""
_MAX_FRAME = 10**9
_NAMED = "named points"
"""Layout of points whose names are in their file."""


@dataclass(frozen=True, eq=False)
class SourceImages:
    """The images in which people are detected. size : width and height, px; None: unknown.

    numbers : numbers of all images, which those of the detections refer to; None: detections are numbered by frame.
    """

    size: tuple[int, int] | None = None
    numbers: IntArray | None = None


@dataclass(frozen=True, eq=False)
class People:
    """People detected in one video.

    Parameters
    ----------
    source : file or folder.
    layout : name in LAYOUTS, or "named points".
    frames : (M,) numbers of the frames, ascending.
    joints : (n, J, 3) per frame, for n people in the order of the file, [u px, v px, confidence 0..1] in the order of
        JOINT_NAMES; NaN for a joint that was not detected and for all joints of an empty person. (n, J, 6) where the
        files have world landmarks, [x, y, z] m about the middle of the hips along the camera's axes. (n, J, 12) where
        the layout has heels or toes, with FOOT_OF_ANKLE, and NaN without world landmarks.
    identities : see `DetectedPoints`.
    """

    source: str
    layout: str
    frames: IntArray
    joints: tuple[FloatArray, ...]
    identities: tuple[IntArray, ...] | None = None

    def at_rows(self, rows: IntArray, frames: IntArray) -> "People":
        """Return the people of some rows of the frames, at other numbers of frames."""
        identities = None if self.identities is None else tuple(self.identities[row] for row in rows)
        return replace(self, frames=frames, joints=tuple(self.joints[row] for row in rows), identities=identities)


def read_people(
    paths: Mapping[str, str | Path],
    images: Mapping[str, SourceImages],
    layout: str | None = None,
    videos: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, People]:
    """Return the people detected in the videos of several cameras by frame, and log what is assumed.

    Parameters
    ----------
    paths : detector's folder or file by camera, see `read_points`.
    images : of each camera.
    layout : name of the detector's layout, see `people_of_points`.
    videos : names for messages by camera, of people whose files are in a cache.

    Raises
    ------
    InputError : as `read_points`, `people_of_points` and `paired_frames`.
    """
    points = {name: read_points(path) for name, path in paths.items()}
    points |= {name: replace(points[name], source=video) for name, video in videos.items()}
    for name, each in points.items():
        points[name], scaling = each.in_pixels(images[name].size)
        if scaling:
            log.warning("%s: %s", each.source, scaling)
    people, decisions = people_of_points(points, layout)
    for view in people.values():
        log.info("%s: %s, %d frames", view.source, view.layout, len(view.frames))
    for name, decision in decisions.items():
        log.info("layout %s of all cameras by anatomy: %s", name, decision)
    numbers = {name: images[name].numbers for name in people}
    for name, view in people.items():
        if numbers[name] is None and view.frames[-1] >= _MAX_FRAME:
            raise InputError(f"{view.source}: expected frames below {_MAX_FRAME}, found {view.frames[-1]}")
    images_by_name = {name: each for name, each in numbers.items() if each is not None}
    frames, assumptions = paired_frames({name: people[name].frames for name in images_by_name}, images_by_name)
    for name, assumption in assumptions.items():
        log.warning("%s: %s", people[name].source, assumption)
    rows = {name: np.flatnonzero(each >= 0) for name, each in frames.items()}
    return people | {name: people[name].at_rows(rows[name], each[rows[name]]) for name, each in frames.items()}


def people_of_points(
    points: Mapping[str, DetectedPoints], layout: str | None = None
) -> tuple[dict[str, People], dict[str, str]]:
    """Return the people of several cameras, and how the layout of ambiguous numbers of points was decided.

    Parameters
    ----------
    points : by camera, in pixels.
    layout : name in LAYOUTS of points without names; None: decided once for all cameras with the same number of points.

    Raises
    ------
    InputError : for a layout with another number of points, an unknown number of points, and names without a joint.
    """
    by_number: dict[int, list[FloatArray]] = {}
    sources = dict[int, str]()
    for each in points.values():
        if not each.names:
            by_number.setdefault(each.n_points, []).extend(each.detected)
            sources.setdefault(each.n_points, each.source)
    layouts, decisions = dict[int, str](), dict[str, str]()
    for number, people in by_number.items():
        if layout is not None:
            check_layout(sources[number], layout, number)
            layouts[number] = layout
            continue
        layouts[number], evidence = matching_layout(sources[number], people)
        if np.isfinite(evidence):
            certainty = "" if evidence >= CLEAR else "not clear, set keypoint_layout; "
            more = f"{100 * np.expm1(evidence):.0f} % more by the next one"
            decisions[layouts[number]] = f"{certainty}bones deviate {more}"
    return {
        name: _people_of(each, _NAMED if each.names else layouts[each.n_points]) for name, each in points.items()
    }, decisions


def _likeliest(points: DetectedPoints) -> DetectedPoints:
    """Return the points of at most MAX_PEOPLE people a frame, those with the largest sums of confidences; logged."""
    crowded = [row for row, people in enumerate(points.points) if len(people) > MAX_PEOPLE]
    if not crowded:
        return points
    message = "%s: %d frames have more than %d people, of which the likeliest are used, frame %d has %d"
    first = crowded[0]
    log.warning(
        message, points.source, len(crowded), MAX_PEOPLE, points.frames[first], len(points.points[first])
    )  # fmt: skip
    chosen, identities = list(points.points), None if points.identities is None else list(points.identities)
    for row in crowded:
        scores = [float(np.nansum(person[:, 2])) for person in points.points[row]]
        rows = np.sort(np.argsort(scores)[-MAX_PEOPLE:])
        chosen[row] = [points.points[row][k] for k in rows]
        if identities is not None:
            identities[row] = identities[row][rows]
    return replace(points, points=tuple(chosen), identities=None if identities is None else tuple(identities))


def _people_of(points: DetectedPoints, name: str) -> People:
    points = _likeliest(points)
    numbers = named_points(points.names) if points.names else layout_joints(LAYOUTS[name])
    if not numbers:
        raise InputError(
            f"{points.source}: no point has the name of a joint, such as left_knee, found {', '.join(points.names)}"
        )
    width = min(person.shape[1] for person in points.detected)
    people = [person[:, :width] for frame in points.points for person in frame]
    empty = np.full((points.n_points, width), np.nan)
    joints = joints_of_points(numbers, np.array([person if len(person) else empty for person in people]), width)
    by_frame = tuple(np.split(joints, np.cumsum([len(frame) for frame in points.points])[:-1]))
    return People(points.source, name, points.frames, by_frame, points.identities)
