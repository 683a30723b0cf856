"""Files of detected people: JSON in the forms of `formats`, and DeepLabCut's CSV files."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.detections.readers.detected_points import DetectedPoints, keypoints_of, numbers_in_names
from workbench.detections.readers.formats import (
    IMAGE_KEY,
    NUMBER_KEY,
    PEOPLE_KEYS,
    PERSON_KEYS,
    REGION_KEY,
    WORLD_KEY,
)
from workbench.detections.readers.layout_by_anatomy import check_number_of_points
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file, parse_json

_HDF5 = (".h5", ".hdf5")
_MAX_NUMBER = 10**9
_DEEPLABCUT = ("scorer", "individuals", "bodyparts", "coords")
"""First cells of the header's lines."""
_COORDINATES = ("x", "y", "likelihood")
_INVALID = (ValueError, KeyError, TypeError, OverflowError)
"""Errors by content of another form."""


def is_detections(path: str | Path) -> bool:
    """Return whether a path is a detector's folder or file, and no CSV file of annotations."""
    path = Path(path)
    if path.is_dir() or path.suffix.lower() in (".json", *_HDF5):
        return True
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(16).decode("utf-8-sig", "replace").startswith("scorer,")


def read_points(path: str | Path) -> DetectedPoints:
    """Return the points in a folder of JSON files, one per frame, a JSON file of all frames or DeepLabCut's CSV file.

    Coordinates that are NaN, null or (0, 0), and points of confidence 0, are missing points. The order of people in a
    frame is arbitrary, see `detections.association`. Raises InputError for files of another format, and if no person is
    detected.
    """
    path = Path(path)
    if path.suffix.lower() in _HDF5 and path.is_file():
        raise InputError(
            f"{path}: expected DeepLabCut's CSV file, found HDF5; write it: analyze_videos_converth5_to_csv"
        )
    if not path.is_file():
        detections = _json_folder(path)
    else:
        detections = _deeplabcut(path) if path.suffix.lower() == ".csv" else _json_file(path)
    detections.check()
    return detections


def _json_folder(folder: Path) -> DetectedPoints:
    """Return the points in a folder of JSON files with the people of one frame each."""
    files = _numbered(folder)
    people, identities = [], list[IntArray | None]()
    for frame in tqdm(sorted(files), desc=folder.name, unit="file", disable=None):
        content = _parsed(files[frame])
        try:
            people.append(_people(content))
            identities.append(_identities(content))
        except _INVALID as error:
            raise _unexpected(files[frame], error) from None
        for n_points in {len(points) for points in people[-1]} - {0}:
            check_number_of_points(files[frame], n_points)
    known = tuple(each for each in identities if each is not None)
    by_frame = known if len(known) == len(files) else None
    return DetectedPoints(str(folder), np.array(sorted(files)), tuple(people), identities=by_frame)


def _numbered(folder: Path) -> dict[int, Path]:
    """Return the files of a folder by frame, the number in their names; files without a number and hidden files are
    skipped."""
    files_in_folder = sorted(folder.glob("*.json")) if folder.is_dir() else []
    files_in_folder = [file for file in files_in_folder if not file.name.startswith(".")]
    numbers = numbers_in_names(file.stem for file in files_in_folder)
    files: dict[int, Path] = {}
    for file in files_in_folder:
        number = numbers.get(file.stem)
        if number is None:
            continue
        if number in files:
            raise InputError(f"{file}: frame {number} is already in {files[number].name}")
        if number >= _MAX_NUMBER:
            raise InputError(f"{file}: expected the frame's number in the file's name, found {number}")
        files[number] = file
    if files_in_folder and not files:
        raise InputError(f"{files_in_folder[0]}: expected the frame's number in the file's name, found none")
    if not files:
        raise InputError(f"{folder}: expected a folder of a detector's JSON files, found none")
    return files


def _json_file(file: Path) -> DetectedPoints:
    """Return the points of a JSON file: a list of people with their image, or people by image."""
    content = _parsed(file)
    by_image: dict[str, list[FloatArray]] = {}
    try:
        if isinstance(content, dict):
            by_image = {image: _people(frame) for image, frame in content.items()}
        else:
            for person in content:
                by_image.setdefault(str(person[IMAGE_KEY]), []).append(_points(person))
    except _INVALID as error:
        raise _unexpected(file, error) from None
    return _ordered(file, [Path(image).stem for image in by_image], list(by_image.values()))


def _parsed(file: Path) -> Any:
    """Return the content of a JSON file; raises InputError for one that cannot be read."""
    try:
        check_file(file)
        return parse_json(file, file.read_bytes())
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None


def _unexpected(file: Path, error: Exception) -> InputError:
    keys = f"{' or '.join(PEOPLE_KEYS)} with {', '.join(PERSON_KEYS)}"
    return InputError(f"{file}: expected {keys}, or a list of people with {IMAGE_KEY}, found {error!r}")


def _people(image: Any) -> list[FloatArray]:
    """Return the points of the people of one image, a list or a mapping with a list, see `_points`."""
    people = image if isinstance(image, list) else image[next((key for key in PEOPLE_KEYS if key in image), "people")]
    return [_points(person) for person in people]


def _identities(image: Any) -> IntArray | None:
    """Return the numbers (n,) by which the workbench's detector follows the people of one image; None for others'."""
    people = image.get("people") if isinstance(image, dict) else None
    if people is None or not all(REGION_KEY in person for person in people):
        return None
    numbers = [int(number) for person in people for number in person[NUMBER_KEY]]
    if len(numbers) != len(people):
        raise ValueError(f"{NUMBER_KEY} of {len(numbers)} numbers for {len(people)} people")
    return np.array(numbers, dtype=np.intp)


def _points(person: Mapping[str, Any]) -> FloatArray:
    """Return a person's points (K, 3), NaN without detection, or (K, 6) with world landmarks; K is 0 for an empty
    person."""
    key = next((key for key in PERSON_KEYS if key in person), "keypoints")
    coordinates, confidence_key = person[key], PERSON_KEYS[key]
    if confidence_key is not None and confidence_key in person:
        coordinates = np.column_stack([np.array(coordinates, dtype=np.float64).reshape(-1, 2), person[confidence_key]])
    points = keypoints_of(coordinates)
    if not len(person.get(WORLD_KEY, ())):
        return points
    world = np.array(person[WORLD_KEY], dtype=np.float64).reshape(-1, 3)
    if len(world) != len(points) or not np.isfinite(world).all():
        raise ValueError(f"{WORLD_KEY} of {len(world)} points, or not finite")
    world[np.isnan(points[:, 0])] = np.nan
    return np.hstack([points, world])


def _deeplabcut(file: Path) -> DetectedPoints:
    """Return the points of DeepLabCut's file, of one individual or several: columns by body part and coordinate."""
    check_file(file)
    try:
        rows = [row for row in csv.reader(file.read_text(encoding="utf-8-sig").splitlines()) if any(row)]
        header = {row[0]: row for row in rows[: len(_DEEPLABCUT)] if row[0] in _DEEPLABCUT}
        body, coordinates = rows[len(header) :], header["coords"]
        first = coordinates.index("x")
        individuals = header.get("individuals", [""] * len(coordinates))
        columns = list(zip(individuals, header["bodyparts"], coordinates, strict=True))[first:]
        values = np.array([[float(cell or "nan") for cell in row[first:]] for row in body]).reshape(-1, len(columns))
        parts = tuple(dict.fromkeys(part for _, part, _ in columns))
        people = []
        for individual in dict.fromkeys(name for name, _, _ in columns):
            points = np.full((len(body), len(parts), 3), np.nan)
            points[..., 2] = 1.0 if "likelihood" not in coordinates else np.nan
            for k, (name, part, coordinate) in enumerate(columns):
                if name == individual:
                    points[:, parts.index(part), _COORDINATES.index(coordinate)] = values[:, k]
            people.append([keypoints_of(each) for each in points])
    except (OSError, UnicodeDecodeError, csv.Error, ValueError, KeyError, IndexError) as error:
        raise InputError(f"{file}: expected DeepLabCut's CSV file with bodyparts and coords, found {error!r}") from None
    names = [Path("_".join(row[:first])).stem for row in body]  # a number, or an image's folders and name
    return _ordered(file, names, [list(frame) for frame in zip(*people, strict=True)], parts)


def _ordered(
    file: Path, names: list[str], people: list[list[FloatArray]], points: tuple[str, ...] = ()
) -> DetectedPoints:
    """Return the people of images by their names' numbers; InputError for a name without or with another's number."""
    numbers = numbers_in_names(names)
    if len(set(numbers.values())) < len(names):
        raise InputError(f"{file}: expected a different number in the name of every image")
    frames = np.array([numbers[name] for name in names], dtype=np.intp)
    order = np.argsort(frames)
    return DetectedPoints(str(file), frames[order], tuple(people[row] for row in order), points)
