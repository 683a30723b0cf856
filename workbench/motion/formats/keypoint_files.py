"""Files of detected people: OpenPose's folders, AlphaPose's JSON files and DeepLabCut's CSV files."""

import csv
from pathlib import Path

import numpy as np

from workbench.motion.formats.detected_points import DetectedPoints, keypoints_of, numbers_in_names
from workbench.motion.formats.openpose import openpose_coordinates, read_folder
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file, parse_json

_HDF5 = (".h5", ".hdf5")
_DEEPLABCUT = ("scorer", "individuals", "bodyparts", "coords")
"""First cells of the header's lines."""
_COORDINATES = ("x", "y", "likelihood")


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
    """Return the points in a folder of OpenPose's JSON files, a JSON file of AlphaPose or a CSV file of DeepLabCut.

    Coordinates that are NaN, null or (0, 0), and points of confidence 0, are missing points. Raises InputError for
    files of another format, and if no person is detected.
    """
    path = Path(path)
    if path.suffix.lower() in _HDF5 and path.is_file():
        raise InputError(
            f"{path}: expected DeepLabCut's CSV file, found HDF5; write it: analyze_videos_converth5_to_csv"
        )
    if not path.is_file():
        return read_folder(path)
    detections = _deeplabcut(path) if path.suffix.lower() == ".csv" else _alphapose(path)
    detections.check()
    return detections


def _alphapose(file: Path) -> DetectedPoints:
    """Return the points of AlphaPose's file: a list of people with image_id and keypoints, or OpenPose's form by
    image."""
    check_file(file)
    content = parse_json(file, file.read_bytes())
    by_image: dict[str, list[FloatArray]] = {}
    try:
        if isinstance(content, dict):
            for image, frame in content.items():
                people = frame["people"] if "people" in frame else frame["bodies"]
                coordinates = [each["joints"] if "joints" in each else openpose_coordinates(each) for each in people]
                by_image[image] = [keypoints_of(each) for each in coordinates]
        else:
            for person in content:
                by_image.setdefault(str(person["image_id"]), []).append(keypoints_of(person["keypoints"]))
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{file}: expected AlphaPose's people with image_id and keypoints, found {error!r}") from None
    return _ordered(file, [Path(image).stem for image in by_image], list(by_image.values()))


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
