"""Detected people as OpenPose's JSON files, one a frame, with world landmarks and times."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.datasets.detection.landmark_network import N_LANDMARKS, LandmarkNetwork, PersonLandmarks, Region
from workbench.datasets.detection.people_detector import PeopleDetector, Person
from workbench.datasets.files.decode import decode, frame_rate, image_files
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json

LAYOUT = "BLAZEPOSE_33"
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
    rate_hz = frame_rate(video) or _DEFAULT_RATE_HZ
    chunk = max(min(round(_CHUNK_S * rate_hz), _CHUNK_BYTES // image.nbytes), 1)
    detector = PeopleDetector(LandmarkNetwork(model), chunk)
    files = _Files(folder, video.stem, source)
    first = files.n_written() // chunk * chunk
    previous = files.read(first - 1) if first else []
    index = first - 1
    with tqdm(desc=f"detecting people in {video.name}", unit="frame", initial=first, disable=None) as progress:
        for index, people in enumerate(detector.detect(decode(video, first), previous), first):
            files.write(index, index / rate_hz, people)
            progress.update()
    return index + 1


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
        if n and self._parsed(n - 1).get("source") != self._source:
            raise InputError(f"{self._folder}: has detections of another video or model; choose another folder by -o")
        return n

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
            return [_of_json(person) for person in self._parsed(index)["people"]]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{self.path(index)}: expected detections by the workbench, found {error!r}") from None

    def _parsed(self, index: int) -> Mapping[str, Any]:
        content = parse_json(self.path(index), self.path(index).read_bytes())
        if not isinstance(content, dict):
            raise InputError(f"{self.path(index)}: expected detections by the workbench")
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
