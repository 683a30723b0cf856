"""Detected people as OpenPose's JSON files, one a frame, with world landmarks and times."""

import hashlib
import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.cameras.image_height import height_px
from workbench.detections.detector.landmark_network import N_LANDMARKS, LandmarkNetwork, PersonLandmarks, Region
from workbench.detections.detector.model_file import model_file
from workbench.detections.detector.people_detector import PeopleDetector, Person
from workbench.utils.atomic_write import whole_file
from workbench.utils.decode import decode, frame_rate, image_files, image_shape
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json
from workbench.utils.input_path import expanded

log = logging.getLogger(__name__)

LAYOUT = "BLAZEPOSE_33"
DETECT = "detect"
"""The value of a dataset's key `keypoints` that detects them."""
_COMPLETE = "complete"
"""Name of the file that holds the number of the frame after the last one of a complete detection."""
_CHUNK_S, _CHUNK_BYTES = 2.0, 500_000_000
"""Time between two searches of the whole image, and the largest size of the images in between."""
_MAX_LISTED = 5
_DEFAULT_RATE_HZ = 30.0
"""Of a folder of images, and of a video whose file has no rate."""
_detection_s = 0.0


def detected_s() -> float:
    """Return the time spent detecting people since the process began, s."""
    return _detection_s


def detect_video(video: Path, folder: Path, model: Path, within: tuple[int, int | None] = (0, None)) -> int:
    """Detect the people in a video, write one JSON file a frame, and return the number of frames that have a file.

    Files of the same video and model that are already in the folder are kept, and the detection is resumed after them.
    What is detected in a frame does not depend on where a detection was interrupted or ended, as whole chunks of frames
    between two searches of the image are detected.

    Parameters
    ----------
    video : a file, or a folder of images.
    folder : for the files, <video>_000000000000_keypoints.json and so on.
    model : a landmark model.
    within : numbers of the first and the last frame needed, None for the end. All files in a folder begin with the
        chunk of the same first frame.

    Raises
    ------
    InputError
        For what cannot be read or written, a video without a frame, and files of another video or model in the folder.
    """
    rate_hz, chunk = _rate_and_chunk(video)
    start = within[0] // chunk * chunk
    source = {"video": _sha256(video), "model": _sha256(model)}
    files = _Files(folder, video.stem, source, start)
    if (n_frames := files.n_complete()) is not None:
        return n_frames
    end = None if within[1] is None else (within[1] // chunk + 1) * chunk
    n_written = files.n_written()
    if end is not None and start + n_written >= end:
        return n_written
    _detect(video, model, files, (start + n_written // chunk * chunk, end), rate_hz, chunk)
    return files.n_written()


def _rate_and_chunk(video: Path) -> tuple[float, int]:
    """Return the frame rate, Hz, and the frames between two searches of the whole image."""
    n_bytes, rate_hz = math.prod(image_shape(video)), frame_rate(video) or _DEFAULT_RATE_HZ
    return rate_hz, max(min(round(_CHUNK_S * rate_hz), _CHUNK_BYTES // n_bytes), 1)


def _detect(
    video: Path, model: Path, files: "_Files", span: tuple[int, int | None], rate_hz: float, chunk: int
) -> None:
    """Detect the people from the first frame of a chunk to before the end of `span`, None for the video's."""
    global _detection_s
    (first, end), began_s = span, perf_counter()
    resumed = first > files.first
    with tqdm(desc=f"detecting people in {video.name}", unit="frame", initial=first, total=end, disable=None) as bar:
        detector = PeopleDetector(LandmarkNetwork(model), chunk, _preview(bar))
        images = decode(video, first, None if end is None else end - 1)
        previous, n_people = (files.read(first - 1), files.n_people(first)) if resumed else (None, 0)
        index = first - 1
        for index, people in enumerate(detector.detect(images, previous, n_people), first):
            files.write(index, index / rate_hz, people)
            bar.update()
    if end is None or index + 1 < end:
        files.complete(index + 1)
    seconds, n = perf_counter() - began_s, index + 1 - first
    _detection_s += seconds
    ms = 1e3 * seconds / max(n, 1)
    log.info("%s: people detected in %d frames in %.1f s, %.0f ms a frame", video, n, seconds, ms)


def _preview(bar: Any) -> Callable[[Sequence[Person]], None]:
    """Return a function that writes to a terminal, once, how many people are found first and how tall they are."""
    waiting = not bar.disable

    def write(people: Sequence[Person]) -> None:
        nonlocal waiting
        if waiting and people:
            heights = sorted((float(height_px(person.landmarks.pixels)) for person in people), reverse=True)
            listed = ", ".join(f"{height:.0f}" for height in heights[:_MAX_LISTED])
            more = f" and {len(heights) - _MAX_LISTED} smaller" if len(heights) > _MAX_LISTED else ""
            bar.write(f"people found so far: {len(people)}, {listed} px tall{more}")
            waiting = False

    return write


def has_people(folder: Path, within: tuple[int, int | None] = (0, None)) -> bool:
    """Return whether a frame of a folder that `detect_video` wrote, from the first to the last one, shows a person."""
    files = {int(path.stem.split("_")[-2]): path for path in sorted(folder.glob("*.json"))}
    last = max(files, default=0) if within[1] is None else within[1]
    return any(_parsed(path).get("people") for index, path in files.items() if within[0] <= index <= last)


def cached_detections(video: Path, model: str, cache: Path, within: tuple[int, int | None] = (0, None)) -> Path:
    """Return the folder in a cache with a video's detections, which are made where they are missing.

    Detections that do not begin with the video's first chunk of frames are in a folder of their own.

    Parameters
    ----------
    video : a file, or a folder of images.
    model : "full", "heavy" or the path of a landmark model, see `model_file`.
    cache : folder for what can be made again.
    within : as of `detect_video`.

    Raises
    ------
    InputError : as `model_file` and `detect_video`, and without a person in these frames.
    """
    _, chunk = _rate_and_chunk(video)  # raises before anything is downloaded
    path, start = model_file(model, cache), within[0] // chunk * chunk
    name = f"{video.stem}_{_sha256(video)[:16]}_{_sha256(path)[:8]}" + (f"_from_{start}" if start else "")
    folder = expanded(cache) / "detections" / name
    n_frames = detect_video(video, folder, path, within)
    log.info("%s: detected people are in %s", video, folder)
    if not has_people(folder, within):
        last = start + n_frames - 1 if within[1] is None else within[1]
        raise InputError(f"{video}: expected a person, found none in {last - within[0] + 1} frames")
    return folder


class _Files:
    """The files of one video's detections, in a folder that is made when the first is written.

    stem: of the files' names. source: hashes of what the detections come from. first: number of the first frame.
    """

    def __init__(self, folder: Path, stem: str, source: Mapping[str, str], first: int) -> None:
        self._folder, self._stem, self._source, self.first = folder, stem, dict(source), first

    def path(self, index: int) -> Path:
        return self._folder / f"{self._stem}_{index:012d}_keypoints.json"

    def n_written(self) -> int:
        """Return how many frames from the first on are written; raises InputError for another video or model's."""
        n = 0
        while self.path(self.first + n).is_file():
            n += 1
        if n and _parsed(self.path(self.first + n - 1)).get("source") != self._source:
            raise InputError(f"{self._folder}: has detections of another video or model; choose another folder by -o")
        return n

    def n_complete(self) -> int | None:
        """Return the number of frames of a complete detection, None for any other; raises InputError as `n_written`."""
        marker = self._folder / _COMPLETE
        n = self.n_written() if marker.is_file() else 0
        return n if n and marker.read_text(encoding="ascii") == str(self.first + n) else None

    def complete(self, end: int) -> None:
        """Mark the detection as complete, with the number of the frame after the last."""
        with whole_file(self._folder / _COMPLETE) as part:
            part.write_text(str(end), encoding="ascii")

    def n_people(self, end: int) -> int:
        """Return the number of people in the frames before `end`."""
        return 1 + max((person.number for index in range(self.first, end) for person in self.read(index)), default=-1)

    def write(self, index: int, time_s: float, people: Sequence[Person]) -> None:
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
