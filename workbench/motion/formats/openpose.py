"""2-D keypoints in OpenPose's JSON files, one file per frame, a format of many detectors, and their people."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.formats.detected_points import DetectedPoints, keypoints_of, numbers_in_names
from workbench.motion.formats.keypoint_layouts import (
    LAYOUTS,
    Layout,
    is_clear,
    joints_of_points,
    layout_named,
    matching_layout,
    named_points,
)
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file, parse_json

_MAX_NUMBER = 10**9


@dataclass(frozen=True, eq=False)
class People:
    """Detected people. source : the folder. layout : in LAYOUTS. frames : (M,) numbers of the frames, ascending.

    joints : (n, J, 3) per frame, for n people in the order of the file, [u px, v px, confidence 0..1] in the order of
    JOINT_NAMES; NaN for a joint that was not detected and for all joints of an empty person. (n, J, 6) where the files
    have world landmarks, [x, y, z] m about the middle of the hips along the camera's axes.
    """

    source: str
    layout: str
    frames: IntArray
    joints: tuple[FloatArray, ...]


def read_openpose(folder: str | Path) -> People:
    """Return the people in a folder of files in pixels; see `read_folder` and `people_of_points`."""
    points, _ = read_folder(Path(folder)).in_pixels(None)
    return people_of_points({"": points})[0][""]


def read_folder(folder: Path) -> DetectedPoints:
    """Return the points in a folder of JSON files with `people[].pose_keypoints_2d` = [u, v, confidence]….

    A point without detection is (0, 0, 0), NaN or null, a person without detection []. A file's frame is the number in
    its name that differs between files; files without a number and hidden files are skipped. The order of people in a
    file is arbitrary, see `datasets.association`. Raises InputError for files of another format, or no person is
    detected.
    """
    files = _numbered(folder)
    people = [_people(files[frame]) for frame in tqdm(sorted(files), desc=folder.name, unit="file", disable=None)]
    detections = DetectedPoints(str(folder), np.array(sorted(files)), tuple(people))
    detections.check()
    return detections


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
    InputError
        For a layout with another number of points, an unknown number of points, and names without a joint.
    """
    by_number: dict[int, list[FloatArray]] = {}
    for each in points.values():
        if not each.names:
            by_number.setdefault(len(each.detected[0]), []).extend(each.detected)
    layouts, decisions = dict[int, str](), dict[str, str]()
    for number, people in by_number.items():
        try:
            layouts[number], evidence = (
                matching_layout(people) if layout is None else (layout_named(layout, number), np.inf)
            )
        except InputError as error:
            source = next(each.source for each in points.values() if len(each.detected[0]) == number)
            raise InputError(f"{source}: {error}") from None
        if np.isfinite(evidence):
            certainty = "" if is_clear(evidence) else "not clear, set keypoint_layout; "
            decisions[layouts[number]] = (
                f"{certainty}bones deviate {100 * np.expm1(evidence):.0f} % more by the next one"
            )
    return {
        name: _people_of(each, "named points" if each.names else layouts[len(each.detected[0])])
        for name, each in points.items()
    }, decisions


def _people_of(points: DetectedPoints, name: str) -> People:
    layout: Layout = named_points(points.names) if points.names else LAYOUTS[name][1]
    if not layout:
        raise InputError(
            f"{points.source}: no point has the name of a joint, such as left_knee, found {', '.join(points.names)}"
        )
    width = min(person.shape[1] for person in points.detected)
    joints = [[joints_of_points(layout, person, width) for person in frame] for frame in points.points]
    by_frame = tuple(np.array(frame).reshape(-1, len(JOINT_NAMES), width) for frame in joints)
    return People(points.source, name, points.frames, by_frame)


def _numbered(folder: Path) -> dict[int, Path]:
    found = sorted(folder.glob("*.json")) if folder.is_dir() else []
    found = [file for file in found if not file.name.startswith(".")]
    numbers = numbers_in_names(file.stem for file in found)
    files: dict[int, Path] = {}
    for file in found:
        number = numbers.get(file.stem)
        if number is None:
            continue
        if number in files:
            raise InputError(f"{file}: frame {number} is already in {files[number].name}")
        if number >= _MAX_NUMBER:
            raise InputError(f"{file}: expected the frame's number in the file's name, found {number}")
        files[number] = file
    if found and not files:
        raise InputError(f"{found[0]}: expected the frame's number in the file's name, found none")
    if not files:
        raise InputError(f"{folder}: expected a folder of OpenPose's JSON files, found none")
    return files


def _people(file: Path) -> list[FloatArray]:
    """Return points (K, 3) of the people in one file, (K, 6) with world landmarks, NaN without detection; K is 0 for an
    empty person."""
    try:
        check_file(file)
        content = parse_json(file, file.read_bytes())
        people = [_points(person) for person in content["people"]]
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{file}: expected OpenPose's people with pose_keypoints_2d, found {error!r}") from None
    sizes = {len(points) for points in people} - {0}
    if len(sizes) > 1 or not sizes <= {n for n, _ in LAYOUTS.values()}:
        options = ", ".join(f"{n} ({name})" for name, (n, _) in LAYOUTS.items())
        raise InputError(f"{file}: expected one of {options} points per person, found {sorted(sizes)}")
    return people


def _points(person: Mapping[str, Any]) -> FloatArray:
    """Return a person's points (K, 3), or (K, 6) with world landmarks."""
    points = keypoints_of(openpose_coordinates(person))
    if not len(person.get("world_landmarks", ())):
        return points
    world = np.array(person["world_landmarks"], dtype=np.float64).reshape(-1, 3)
    if len(world) != len(points) or not np.isfinite(world).all():
        raise ValueError(f"world_landmarks of {len(world)} points, or not finite")
    world[np.isnan(points[:, 0])] = np.nan
    return np.hstack([points, world])


def openpose_coordinates(person: Mapping[str, Any]) -> Any:
    """Return a person's flat coordinates; OpenPose's first version named them without a dimension."""
    return person["pose_keypoints" if "pose_keypoints" in person else "pose_keypoints_2d"]
