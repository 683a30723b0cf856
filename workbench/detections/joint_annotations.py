"""Joints of one person in a video, annotated by hand in a CSV file or detected."""

import csv
import logging
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.association.target_selection import TargetPerson, select_target
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.keypoint_files import is_detections
from workbench.detections.readers.named_points import foot_points
from workbench.detections.readers.people import People, SourceImages, read_people
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.frame_times import FrameTimes
from workbench.utils.input_limits import LARGEST_PX
from workbench.utils.text import read_text

log = logging.getLogger(__name__)

COLUMNS = ("frame", "joint", "u", "v", "visible")
_POINTS = {point for layout in LAYOUTS.values() for point in layout}.union(("left_toe", "right_toe")).difference(
    JOINT_NAMES, "-"
)
"""Points of a person, as detectors name them, that are no joints of the body."""


@dataclass(frozen=True, eq=False)
class JointAnnotations:
    """Annotated or detected joints in M frames of one video.

    Parameters
    ----------
    source : file of the joints.
    frames : (M,) numbers of the frames in their video, increasing.
    pixels : (M, J, 2) joints [u, v] in the full-size image, with the centre of the top left pixel at (0, 0), in the
        order of JOINT_NAMES; NaN for joints without an annotation.
    visible : (M, J), false for an annotation of an occluded joint, and without an annotation.
    confidence : (M, J) of a detector, 0..1, NaN without a detection; None for annotations.
    counts : see `TargetPerson`.
    world_landmarks : (M, J, 3) of a detector, see `View`; None without.
    feet : (M, 4, 3) of a detector, see `View`; None without.
    other_points : names of annotated points that are no joints of the body, and therefore omitted.
    """

    source: str
    frames: IntArray
    pixels: FloatArray
    visible: BoolArray
    confidence: FloatArray | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    world_landmarks: FloatArray | None = None
    feet: FloatArray | None = None
    other_points: tuple[str, ...] = ()

    @property
    def detected_frames(self) -> IntArray:
        """The numbers of the frames with any joint, increasing."""
        return self.frames[np.isfinite(self.pixels[..., 0]).any(axis=1)]

    def at(self, frame: int) -> tuple[FloatArray, BoolArray] | None:
        """Return pixels (J, 2) and visibility (J,) of a frame's annotations; None without any."""
        if frame not in self.frames:
            return None
        row = int(np.searchsorted(self.frames, frame))
        return self.pixels[row], self.visible[row]

    def weighted(self, frame: int, occluded_weight: float) -> FloatArray | None:
        """Return a frame's annotations (J, 3), [u, v, weight]; None without any. The weight is a detector's confidence,
        or else 1 for visible and `occluded_weight` for occluded joints."""
        if frame not in self.frames:
            return None
        row = int(np.searchsorted(self.frames, frame))
        weights = np.where(self.visible[row], 1.0, occluded_weight) if self.confidence is None else self.confidence[row]
        return np.column_stack([self.pixels[row], np.where(np.isnan(self.pixels[row, :, 0]), np.nan, weights)])

    def world_landmarks_at(self, frame: int) -> FloatArray | None:
        """Return a frame's world landmarks (J, 3), m; None without any."""
        if self.world_landmarks is None or frame not in self.frames:
            return None
        return np.asarray(self.world_landmarks[int(np.searchsorted(self.frames, frame))])

    def feet_at(self, frame: int) -> FloatArray | None:
        """Return a frame's FOOT_POINTS (4, 3), [u, v, confidence]; None without any."""
        if self.feet is None or frame not in self.frames:
            return None
        return np.asarray(self.feet[int(np.searchsorted(self.frames, frame))])

    def select(self, rows: BoolArray) -> "JointAnnotations":
        """Return the annotations of the frames with `rows` (M,) true."""
        confidence = None if self.confidence is None else self.confidence[rows]
        frames, pixels, visible = self.frames[rows], self.pixels[rows], self.visible[rows]
        world = None if self.world_landmarks is None else self.world_landmarks[rows]
        feet = None if self.feet is None else self.feet[rows]
        return JointAnnotations(self.source, frames, pixels, visible, confidence, self.counts, world, feet)


AT_30_HZ, UNKNOWN_IMAGES = FrameTimes(30.0), SourceImages()
"""Of detections that are read without their video."""


def read_annotations(
    path: str | Path, person: int | str | None = None, times: FrameTimes = AT_30_HZ,
    within: tuple[int, int | None] = (0, None), images: SourceImages = UNKNOWN_IMAGES, layout: str | None = None,
    video: Path | None = None,
) -> JointAnnotations:  # fmt: skip
    """Read a CSV file of annotations, or one person's detections in a detector's folder or file.

    The CSV file has the columns frame, joint, u, v, visible, in any order; visible is 0 or 1. Points of a person that
    are no joints of the body, such as the toes, are omitted, which is logged.

    Parameters
    ----------
    path : file or folder.
    person, times, within : of detections, see `select_target`.
    images, layout : of detections, see `read_people`.
    video : in which the workbench's own detector detected them, for messages; only detections `within` are then read.

    Raises
    ------
    InputError
        As `read_people` and `select_target` and, with the file and the line, for a missing or empty file, missing or
        unknown columns, an unknown joint, a value that is not a number, and a repeated joint in a frame.
    """
    path = Path(path)
    if is_detections(path):
        people = read_view(path, within, images, layout, video)
        target = select_target(people, None, times.rate_hz, person, within, times.uneven_s)
        return target_annotations(next(iter(people.values())), target, 0)
    annotations: dict[tuple[int, str], tuple[int, float, float, bool]] = {}
    for line, row in _rows(path):
        frame, joint, u, v, visible = _parse(f"{path}:{line}", row)
        if (frame, joint) in annotations:
            before = annotations[frame, joint][0]
            raise InputError(f"{path}:{line}: {joint} of frame {frame} is already annotated in line {before}")
        annotations[frame, joint] = line, u, v, visible
    others = sorted({joint for _, joint in annotations} & _POINTS)
    annotations = {place: annotation for place, annotation in annotations.items() if place[1] not in _POINTS}
    if others:
        log.warning("%s: not used, because the body has no such joints: %s", path, ", ".join(others))
    if not annotations:
        raise InputError(f"{path}: expected at least one annotation below the header {','.join(COLUMNS)}, found none")
    frames = sorted({frame for frame, _ in annotations})
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    is_visible = np.zeros((len(frames), len(JOINT_NAMES)), bool)
    for (frame, joint), (_, u, v, visible) in annotations.items():
        place = frames.index(frame), JOINT_NAMES.index(joint)
        pixels[place], is_visible[place] = (u, v), visible
    return JointAnnotations(str(path), np.array(frames), pixels, is_visible, other_points=tuple(others))


def read_view(
    path: Path, within: tuple[int, int | None], images: SourceImages, layout: str | None, video: Path | None
) -> dict[str, People]:
    """Return the people detected in a single video by its name; parameters and errors as of `read_annotations`."""
    name = path.name if video is None else str(video)
    people = read_people({name: path}, {name: images}, layout, {} if video is None else {name: name})
    if video is None:
        return people
    rows = np.flatnonzero(
        (people[name].frames >= within[0]) & (people[name].frames <= (np.inf if within[1] is None else within[1]))
    )
    return {name: people[name].at_rows(rows, people[name].frames[rows])}


def target_annotations(people: People, target: TargetPerson, view: int) -> JointAnnotations:
    """Return the target person's detections in a view."""
    in_view = np.isin(target.frames, people.frames)
    frames, joints = target.frames[in_view], target.joints[view][in_view]
    pixels, confidence = joints[..., :2], joints[..., 2]
    world = joints[..., 3:6] if np.isfinite(joints[..., 3:6]).any() else None
    visible, feet = np.isfinite(confidence), foot_points(joints)
    return JointAnnotations(people.source, frames, pixels, visible, confidence, target.counts, world, feet)


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line numbers and cells, by column, of the rows that are not blank."""
    if not path.exists():
        raise InputError(f"{path}: no such file of annotations")
    reader = csv.reader(read_text(path).split("\n"))
    try:
        header = [cell.strip() for cell in next(reader, [])]
        if sorted(header) != sorted(COLUMNS):
            raise InputError(f"{path}:1: expected the columns {','.join(COLUMNS)}, found {','.join(header)!r}")
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                raise InputError(f"{path}:{reader.line_num}: expected {len(header)} cells, found {len(cells)}")
            yield reader.line_num, {name: cell.strip() for name, cell in zip(header, cells, strict=True)}
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: {error}") from None


def _parse(place: str, row: dict[str, str]) -> tuple[int, str, float, float, bool]:
    if not (row["frame"].isascii() and row["frame"].isdigit() and len(row["frame"]) < 10):
        raise InputError(f"{place}: expected a frame number, found {row['frame']!r}")
    if row["joint"] not in JOINT_NAMES and row["joint"] not in _POINTS:
        raise InputError(f"{place}: unknown joint {row['joint']!r}, expected one of {', '.join(JOINT_NAMES)}")
    if row["visible"] not in ("0", "1"):
        raise InputError(f"{place}: visible must be 0 or 1, found {row['visible']!r}")
    u, v = _pixel(place, "u", row["u"]), _pixel(place, "v", row["v"])
    return int(row["frame"]), row["joint"], u, v, row["visible"] == "1"


def _pixel(place: str, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}: {name} must be a number of pixels, found {cell!r}")
    if abs(value) > LARGEST_PX:
        raise InputError(f"{place}: {name} must lie within {LARGEST_PX:g} px, found {cell!r}")
    return value
