"""Detected people as OpenPose's JSON files, one a frame, with world landmarks and times."""

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.detections.detector.landmark_network import N_LANDMARKS, LandmarkNetwork, PersonLandmarks, Region
from workbench.detections.detector.model_file import model_file
from workbench.detections.detector.people_detector import PeopleDetector, Person
from workbench.utils.atomic_write import whole_file
from workbench.utils.decode import decode, frame_rate, image_files
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json

log = logging.getLogger(__name__)

LAYOUT = "BLAZEPOSE_33"
DETECT = "detect"
"""The value of a dataset's key `keypoints` that detects them."""
_COMPLETE = "complete"
"""Name of the file that holds the number of frames of a complete detection."""
_CHUNK_S, _CHUNK_BYTES = 2.0, 500_000_000
"""Time between two searches of the whole image, and the largest size of the images in between."""
_DEFAULT_RATE_HZ = 30.0
"""Of a folder of images, and of a video whose file has no rate."""


def detect_video(video: Path, folder: Path, model: Path) -> int:
    """Detect the people in a video, write one JSON file a frame, and return the number of frames.

    Files of the same video and model that are already in the folder are kept, and the detection is resumed after them.

    Parameters
    ----------
    video : a file, or a folder of images.
    folder : for the files, <video>_000000000000_keypoints.json and so on.
    model : a landmark model.

    Raises
    ------
    InputError
        For what cannot be read or written, a video without a frame, and files of another video or model in the folder.
    """
    image = next(decode(video, 0, 0), None)
    if image is None:
        raise InputError(f"{video}: expected at least one frame, found none")
    source = {"video": _sha256(video), "model": _sha256(model)}
    files = _Files(folder, video.stem, source)
    if (n_frames := files.n_complete()) is not None:
        return n_frames
    rate_hz = frame_rate(video) or _DEFAULT_RATE_HZ
    chunk = max(min(round(_CHUNK_S * rate_hz), _CHUNK_BYTES // image.nbytes), 1)
    detector = PeopleDetector(LandmarkNetwork(model), chunk)
    first = files.n_written() // chunk * chunk
    previous = files.read(first - 1) if first else []
    index = first - 1
    with tqdm(desc=f"detecting people in {video.name}", unit="frame", initial=first, disable=None) as progress:
        for index, people in enumerate(detector.detect(decode(video, first), previous), first):
            files.write(index, index / rate_hz, people)
            progress.update()
    files.complete(index + 1)
    return index + 1


def has_people(folder: Path) -> bool:
    """Return whether any frame of a folder that `detect_video` wrote shows a person."""
    return any(_parsed(path).get("people") for path in sorted(folder.glob("*.json")))


def cached_detections(video: Path, model: str, cache: Path) -> Path:
    """Return the folder in a cache with a video's detections, which are made where they are missing.

    Parameters
    ----------
    video : a file, or a folder of images.
    model : "full", "heavy" or the path of a landmark model, see `model_file`.
    cache : folder for what can be made again.

    Raises
    ------
    InputError
        As `model_file` and `detect_video`, and for a video without a person.
    """
    if next(decode(video, 0, 0), None) is None:  # before anything is downloaded
        raise InputError(f"{video}: expected at least one frame, found none")
    path = model_file(model, cache)
    folder = cache.expanduser() / "detections" / f"{video.stem}_{_sha256(video)[:16]}_{_sha256(path)[:8]}"
    log.info("people detected in %s: %s", video, folder)
    n_frames = detect_video(video, folder, path)
    if not has_people(folder):
        raise InputError(f"{video}: expected a person, found none in {n_frames} frames")
    return folder


class _Files:
    """The files of one video's detections.

    Parameters
    ----------
    folder : of the files, made when the first is written.
    stem : of the files' names.
    source : hashes of what the detections come from.
    """

    def __init__(self, folder: Path, stem: str, source: Mapping[str, str]) -> None:
        self._folder, self._stem, self._source = folder, stem, dict(source)

    def path(self, index: int) -> Path:
        """Return the file of a frame."""
        return self._folder / f"{self._stem}_{index:012d}_keypoints.json"

    def n_written(self) -> int:
        """Return how many frames from the first on are written.

        Raises
        ------
        InputError
            Where they come from another video or model.
        """
        n = 0
        while self.path(n).is_file():
            n += 1
        if n and _parsed(self.path(n - 1)).get("source") != self._source:
            raise InputError(f"{self._folder}: has detections of another video or model; choose another folder by -o")
        return n

    def n_complete(self) -> int | None:
        """Return the number of frames of a complete detection; None for any other.

        Raises
        ------
        InputError
            As `n_written`.
        """
        marker = self._folder / _COMPLETE
        n = self.n_written() if marker.is_file() else 0
        return n if n and marker.read_text(encoding="ascii") == str(n) else None

    def complete(self, n_frames: int) -> None:
        """Mark the detection as complete."""
        with whole_file(self._folder / _COMPLETE) as part:
            part.write_text(str(n_frames), encoding="ascii")

    def write(self, index: int, time_s: float, people: Sequence[Person]) -> None:
        """Write the people of a frame."""
        content = {
            "version": 1.3, "layout": LAYOUT, "time_s": time_s, "source": self._source,
            "people": [_as_json(person) for person in people],
        }  # fmt: skip
        with whole_file(self.path(index), parents=True) as part:
            part.write_text(json.dumps(content), encoding="ascii")

    def read(self, index: int) -> list[Person]:
        """Return the people of a frame that `write` wrote; InputError for any other content."""
        try:
            return [_of_json(person) for person in _parsed(self.path(index))["people"]]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{self.path(index)}: expected detections by the workbench, found {error!r}") from None


def _parsed(path: Path) -> Mapping[str, Any]:
    content = parse_json(path, path.read_bytes())
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected detections by the workbench")
    return content


def _as_json(person: Person) -> dict[str, Any]:
    landmarks, region = person.landmarks, person.landmarks.next_region
    keypoints = np.column_stack([landmarks.pixels, landmarks.confidence])
    return {
        "person_id": [person.number],
        "pose_keypoints_2d": np.round(keypoints, 3).ravel().tolist(),
        "world_landmarks": np.round(landmarks.world, 4).ravel().tolist(),
        "presence": round(landmarks.presence, 4),
        "region": [region.u, region.v, region.side, region.angle],
    }


def _of_json(person: Mapping[str, Any]) -> Person:
    keypoints = np.array(person["pose_keypoints_2d"], dtype=np.float64).reshape(N_LANDMARKS, 3)
    world = np.array(person["world_landmarks"], dtype=np.float64).reshape(N_LANDMARKS, 3)
    region = Region(*(float(number) for number in person["region"]))
    landmarks = PersonLandmarks(keypoints[:, :2], keypoints[:, 2], world, float(person["presence"]), region)
    return Person(int(person["person_id"][0]), landmarks)


def _sha256(path: Path) -> str:
    """Return the hash of a file, or of a folder's images."""
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    return hashlib.sha256("".join(_sha256(file) for file in image_files(path)).encode()).hexdigest()
