"""Files of detected people in the forms of `formats`: JSON, text of Ultralytics, and tables, see `keypoint_tables`."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.detections.readers.detected_points import DetectedPoints, keypoints_of, numbers_in_names, ordered_points
from workbench.detections.readers.formats import (
    COORDINATES,
    DATASET_KEYS,
    FRAME_KEYS,
    FRAMES_KEYS,
    NUMBER_KEY,
    PEOPLE_KEYS,
    PERSON_KEYS,
    POINT_NAME_KEYS,
    REGION_KEY,
    SIZES,
    TEXT_COLUMNS,
    WORLD_KEY,
)
from workbench.detections.readers.keypoint_tables import is_table, read_table
from workbench.detections.readers.layout_by_anatomy import check_number_of_points, unlike_layouts
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file, parse_json
from workbench.utils.text import read_text

_HDF5 = (".h5", ".hdf5")
_TABLES = (".csv", ".tsv")
_JSON = (".json", ".jsonl", ".ndjson")
_SUFFIXES = (".json", ".txt")
"""Of files in a folder, of which the first kind that is there is read."""
_MAX_JSON = 150_000_000
"""Bytes of a JSON file: its numbers take up to ten times as much memory."""
_INVALID = (ValueError, KeyError, TypeError, OverflowError, AttributeError)
"""Errors by content of another form."""


def is_detections(path: str | Path) -> bool:
    """Return whether a path is a detector's folder or file, and no CSV file of annotations."""
    path = Path(path)
    if path.is_dir() or path.suffix.lower() in (*_JSON, *_HDF5):
        return True
    return path.suffix.lower() in _TABLES and path.is_file() and is_table(path)


def read_points(path: str | Path) -> DetectedPoints:
    """Return the points in a folder of JSON or text files, one per frame, or in a JSON or CSV file of all frames.

    Coordinates that are NaN, null or (0, 0), and points of confidence 0, are missing points. The order of people in a
    frame is arbitrary, see `detections.association`. Raises InputError for another format, and without a person.
    """
    path = Path(path)
    if path.suffix.lower() in _HDF5 and path.is_file():
        raise InputError(
            f"{path}: expected DeepLabCut's CSV file, found HDF5; write it: analyze_videos_converth5_to_csv"
        )
    if not path.is_file():
        detections = _folder(path)
    else:
        detections = read_table(path) if path.suffix.lower() in _TABLES else _json_file(path, _parsed(path))
    detections.check()
    return detections


def _folder(folder: Path) -> DetectedPoints:
    """Return the points in a folder of files with the people of one frame each, or of one JSON file of all frames."""
    present = sorted(file for file in folder.iterdir() if file.name[0] != ".") if folder.is_dir() else []
    suffix = next((each for each in _SUFFIXES if any(file.suffix.lower() == each for file in present)), "")
    files_in_folder = [file for file in present if suffix and file.suffix.lower() == suffix]
    is_one = suffix == ".json" and len(files_in_folder) == 1
    if is_one and _frames_of(content := _parsed(files_in_folder[0])) is not None:
        return _json_file(files_in_folder[0], content)
    files = _numbered(folder, files_in_folder)
    people, identities, names = [], list[IntArray | None](), tuple[str, ...]()
    for frame in tqdm(sorted(files), desc=folder.name, unit="file", disable=None):
        if suffix == ".txt":
            people.append(_text_people(files[frame]))
            continue
        content = _parsed(files[frame])
        try:
            names = names or _names(content, [content])
            people.append(_people(content, names))
            identities.append(_identities(content))
        except _INVALID as error:
            raise _unexpected(files[frame], error) from None
        for n_points in {len(points) for points in people[-1]} - {0} if not names else ():
            check_number_of_points(files[frame], n_points)
    known = tuple(each for each in identities if each is not None)
    by_frame = known if len(known) == len(files) else None
    return DetectedPoints(str(folder), np.array(sorted(files)), tuple(people), names, by_frame)


def _numbered(folder: Path, files_in_folder: Sequence[Path]) -> dict[int, Path]:
    """Return the files of a folder by frame, the number in their names; files without a number are skipped."""
    numbers = numbers_in_names(file.stem for file in files_in_folder)
    files: dict[int, Path] = {}
    for file in files_in_folder:
        number = numbers.get(file.stem)
        if number is None:
            continue
        if number in files:
            raise InputError(f"{file}: frame {number} is already in {files[number].name}")
        files[number] = file
    if files_in_folder and not files:
        raise InputError(f"{files_in_folder[0]}: expected the frame's number in the file's name, found none")
    if not files:
        raise InputError(f"{folder}: expected a folder of a detector's JSON files or Ultralytics' text, found none")
    return files


def _json_file(file: Path, content: Any) -> DetectedPoints:
    """Return the points of the content of a JSON file of all frames."""
    by_image: dict[str, list[FloatArray]] = {}
    try:
        frames = _frames_of(content) or list(content.items())
        names = _names(content, [people for _, people in frames])
        for image, people in frames:
            by_image.setdefault(Path(str(image)).stem, []).extend(_people(people, names))
    except _INVALID as error:
        raise _unexpected(file, error) from None
    return ordered_points(file, list(by_image), list(by_image.values()), names)


def _names(content: Any, images: Iterable[Any]) -> tuple[str, ...]:
    """Return the names of the points that a file states; () for none, and where they are those of a layout in order.

    They are in COCO's categories, in MMPose's meta_info, or in the points of the first person that has some.
    """
    names = list[Any]()
    if isinstance(content, dict):
        stated = [each["keypoints"] for each in content.get("categories") or () if "keypoints" in each]
        by_number = (content.get("meta_info") or {}).get("keypoint_id2name") or {}
        names = next(iter(stated), [by_number[key] for key in sorted(by_number, key=int)])
    points = next((points for image in images for person in _list_of_people(image) if (points := _named(person))), {})
    return unlike_layouts(tuple(map(str, names or points)))


def _frames_of(content: Any) -> list[tuple[Any, Any]] | None:
    """Return the images, by number or name, with their people, of a file of all frames; None for another one.

    Elements of a list are people, or images with a list of them; without a key of their image they are images in order.
    """
    if isinstance(content, dict) and set(DATASET_KEYS) <= content.keys():
        names = {image["id"]: image.get("file_name", image["id"]) for image in content["images"]}
        annotated = [(names[each["image_id"]], [each]) for each in content["annotations"] if "keypoints" in each]
        return [*((name, []) for name in names.values()), *annotated]
    key = next((key for key in FRAMES_KEYS if isinstance(content, dict) and isinstance(content.get(key), list)), None)
    elements = content if key is None else content[key]
    if not isinstance(elements, list):
        return None
    first = elements[0] if elements and isinstance(elements[0], dict) else {}
    image_key = next((key for key in FRAME_KEYS if key in first), "")
    if not image_key and not all(isinstance(each, list) or _has_people(each) for each in elements):
        return None
    images = [each if isinstance(each, list) or _has_people(each) else [each] for each in elements]
    return [(each[image_key] if image_key else k, images[k]) for k, each in enumerate(elements)]


def _has_people(image: Any) -> bool:
    return isinstance(image, dict) and any(key in image for key in PEOPLE_KEYS)


def _parsed(file: Path) -> Any:
    """Return the content of a JSON file, as a list of JSON Lines; raises InputError if it cannot be read."""
    try:
        check_file(file, _MAX_JSON)
        content = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None
    lines = content.split(b"\n", 2)[:2]
    if len(lines) > 1 and all(line.strip().startswith(b"{") and line.strip().endswith(b"}") for line in lines):
        return [parse_json(file, line) for line in content.split(b"\n") if line.strip()]  # JSON Lines, of OpenPifPaf
    return parse_json(file, content)


def _unexpected(file: Path, error: Exception) -> InputError:
    keys = f"{', '.join(PEOPLE_KEYS)} with {', '.join(PERSON_KEYS)}"
    return InputError(
        f"{file}: expected {keys}, or a list of people with {' or '.join(FRAME_KEYS[:2])}, found {error!r}"
    )


def _list_of_people(image: Any) -> Any:
    """Return the people of one image, a list or a mapping with a list."""
    return image if isinstance(image, list) else image[next((key for key in PEOPLE_KEYS if key in image), "people")]


def _people(image: Any, names: tuple[str, ...]) -> list[FloatArray]:
    return [_points(person, names) for person in _list_of_people(image)]


def _identities(image: Any) -> IntArray | None:
    """Return the numbers (n,) by which the workbench's detector follows the people of one image; None for others'."""
    people = image.get("people") if isinstance(image, dict) else None
    if people is None or not all(REGION_KEY in person for person in people):
        return None
    numbers = [int(number) for person in people for number in person[NUMBER_KEY]]
    if len(numbers) != len(people):
        raise ValueError(f"{NUMBER_KEY} of {len(numbers)} numbers for {len(people)} people")
    return np.array(numbers, dtype=np.intp)


def _points(person: Mapping[str, Any], names: tuple[str, ...]) -> FloatArray:
    """Return a person's points (K, 3), NaN without detection, or (K, 6) with world landmarks; K is 0 for an empty
    person. names : of the points where they are mappings with names, of which some may be absent."""
    key = next((key for key in PERSON_KEYS if key in person), "keypoints")
    coordinates = person[key]
    if isinstance(coordinates, dict):  # a list by coordinate, of Ultralytics
        coordinates = [dict(zip(coordinates, point, strict=True)) for point in zip(*coordinates.values(), strict=True)]
    if names and (named := _named(person)):
        coordinates = [named.get(name, {"x": np.nan, "y": np.nan}) for name in names]
    if len(coordinates) and isinstance(coordinates[0], dict):
        coordinates = [_coordinates(point) for point in coordinates]
    elif names:
        coordinates = np.reshape(coordinates, (len(names) if len(coordinates) else 0, -1))
    if confidences := next((person[name] for name in PERSON_KEYS[key] if name in person), None):
        coordinates = np.column_stack([np.array(coordinates, dtype=np.float64).reshape(-1, 2), confidences])
    points = keypoints_of(coordinates)
    if not len(person.get(WORLD_KEY, ())):
        return points
    world = np.array(person[WORLD_KEY], dtype=np.float64).reshape(-1, 3)
    if len(world) != len(points) or not np.isfinite(world).all():
        raise ValueError(f"{WORLD_KEY} of {len(world)} points, or not finite")
    world[np.isnan(points[:, 0])] = np.nan
    return np.hstack([points, world])


def _named(person: Any) -> dict[str, Any]:
    """Return a person's points by name, where they are mappings with one."""
    points = next((person[key] for key in PERSON_KEYS if key in person), ()) if isinstance(person, dict) else ()
    first = points[0] if isinstance(points, list) and points else {}
    keys = [key for key in POINT_NAME_KEYS if isinstance(first, dict) and key in first]
    return {point[keys[0]]: point for point in points} if keys else {}


def _coordinates(point: Mapping[str, Any]) -> list[Any]:
    """Return u, v and confidence of a point by the names in COORDINATES; a confidence of 1 without one."""
    point = {**point, **point.get("position", {})}  # of PoseNet
    found = {COORDINATES[name]: value for name, value in point.items() if name in COORDINATES}
    return [found[0], found[1], found.get(2, 1.0)]


def _text_people(file: Path) -> list[FloatArray]:
    """Return the points of the people of one image, of Ultralytics' text with fractions of the image's size."""
    people = []
    for line, words in enumerate(map(str.split, read_text(file).split("\n")), 1):
        n = len(words) - TEXT_COLUMNS
        forms = ((width, n - more) for width in (3, 2) for more in (0, 1, 2))
        width, size = next(((w, m) for w, m in forms if m % w == 0 and m // w in SIZES), (0, 0))
        if not words:
            continue
        try:
            if not width:
                raise ValueError(f"{len(words)} numbers")
            people.append(keypoints_of(np.array(words[TEXT_COLUMNS : TEXT_COLUMNS + size], float).reshape(-1, width)))
        except ValueError as error:
            raise InputError(
                f"{file}, line {line}: expected Ultralytics' class, box and points of a person, found {error}"
            ) from None
    return people
