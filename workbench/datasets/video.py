"""Real video: a file or a folder of images, seen by a calibrated camera, with joints marked by hand in some frames."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from workbench.body.camera import Camera, load_cameras
from workbench.core.capabilities import IMAGES, KEYPOINTS, ONE_CAMERA, START, Traits, component_traits
from workbench.core.checks import UNIT, UP_TO_1, check
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import AnnotatedFrames, Frame, Truth, View
from workbench.core.side_information import INITIAL_ANNOTATIONS
from workbench.datasets.files.decode import count_frames, decode, frame_rate
from workbench.datasets.files.joint_annotations import Marks, read_marks
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_rate

_LEAST_SIZE_PX = 16
_MOST_STRETCHED = 0.01
"""Images may be larger or smaller than the camera's by this part: encoders cut or pad to multiples of their blocks."""


@dataclass(eq=False)
class Video:
    """A video and its camera; the images are RGB, and everything in pixels follows their scale.

    source: a video file that OpenCV reads, or a folder of images, taken in natural order (frame_9 before frame_10).
    camera: a camera file of the Pose2Sim and Sports2D form. which: the name of a camera in it; the first without one.
    first_frame: the number of the first frame used, counted from 0 in the source. n_frames: how many are used; None: to
    the end. scale: the factor by which images are resized.
    rate_hz: frames per second, where the source does not say or says it wrongly. initial_annotations: a file of marks,
    of which those at first_frame, with those of later frames up to start_last, give the start. keypoints: a file of
    marks, or a folder of what a detector found (OpenPose's JSON), that are observations. person: the number of the one
    to follow among those found in the first frame that shows anybody, None for the one of them who is seen largest and
    surest. eval_marks: the same that is truth for the evaluation only. held_out: frames whose marks are kept from the
    keypoints; with some, eval_marks measures in these alone. hidden_weight: the weight of a mark on a hidden joint,
    visible ones having 1; 0.35 because hidden joints are marked to 6–10 px, visible ones to 4; a detector's is its
    confidence.

    Images that are up to 1 % off the camera's size are stretched to it, with a warning. Raises InputError for numbers
    out of range and, when asked what is known, for what cannot be read, frames that are not there, images of another
    size, a missing frame rate, start marks that leave out the first frame and frames held out that are not marked.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images of one camera, and the joints and the start that are given."""
        keypoints = () if keys.get("keypoints") is None else (KEYPOINTS, START)
        marks = () if keys.get("initial_annotations") is None else (START, INITIAL_ANNOTATIONS)
        return component_traits(IMAGES, ONE_CAMERA, *keypoints, *marks)

    source: str
    camera: str
    which: str | None = None
    first_frame: int = 0
    n_frames: int | None = None
    scale: float = 1.0
    rate_hz: float | None = None
    initial_annotations: str | None = None
    start_last: int | None = None
    keypoints: str | None = None
    eval_marks: str | None = None
    held_out: Sequence[int] = ()
    hidden_weight: float = 0.35
    person: int | None = None

    def __post_init__(self) -> None:
        check("video", self, scale=UP_TO_1, hidden_weight=UNIT)
        if self.first_frame < 0:
            raise InputError(f"video: first_frame must be at least 0, found {self.first_frame}")
        if self.n_frames is not None and self.n_frames < 1:
            raise InputError(f"video: n_frames must be at least 1, found {self.n_frames}")

    @cached_property
    def info(self) -> SequenceInfo:
        """The camera of the resized images, and what is marked."""
        n_frames = self.last - self.first_frame + 1
        first, camera = next(decode(self._path)), self.source_camera
        self._check_size(first)
        if first.shape[:2] != (camera.height, camera.width):
            size, expected = f"{first.shape[1]}×{first.shape[0]}", f"{camera.width}×{camera.height}"
            warnings.warn(f"{self.source}: images of {size} are stretched to the camera's {expected}", stacklevel=2)
        if min(camera.width, camera.height) * self.scale < _LEAST_SIZE_PX:
            size = f"{camera.width * self.scale:.0f}×{camera.height * self.scale:.0f} px"
            raise InputError(f"video: scale {self.scale} leaves {size} of an image, expected at least {_LEAST_SIZE_PX}")
        _ = self._truth  # read now, so that mistakes show before the first frame
        marked = np.empty(0) if self._keypoints is None else self._keypoints.frames
        counted = {} if self._keypoints is None else self._keypoints.counted
        return SequenceInfo(
            name=self._path.name, n_frames=n_frames, rate_hz=self.true_rate_hz, scale=self.scale,
            source_rate_hz=None if self.rate_hz is None else frame_rate(self._path),
            cameras=(self.source_camera.scaled(self.scale),), initial_annotations=self._first_marks(),
            has_keypoints=bool(((marked >= self.first_frame) & (marked <= self.last)).any()), counted=counted,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order, decoded one by one: seeking in a video file is not to be relied on."""
        (camera,) = self.info.cameras
        index = self.first_frame - 1
        for index, image in enumerate(decode(self._path, self.first_frame, self.last), self.first_frame):
            self._check_size(image)
            view = View(camera, self._scaled(image), self.scaled_marks(self._keypoints, index))
            marked = None if self._truth is None else self._truth.at(index)
            truth = marked and Truth(marks=_resized(marked[0], self.scale), annotations_visible=marked[1])
            yield Frame(index, index / self.true_rate_hz, (view,), truth)
        if index < self.last:
            raise InputError(f"{self.source}: ends before frame {self.last}, which was there before")

    @cached_property
    def true_rate_hz(self) -> float:
        """Frames per second: as given, or as the source says."""
        rate = frame_rate(self._path) if self.rate_hz is None else self.rate_hz
        if rate is None:
            raise InputError(f"{self.source}: does not say its frame rate; set rate_hz")
        if not 0.0 < rate < np.inf:
            raise InputError(f"video: rate_hz must be positive, found {rate}")
        return check_rate(f"{self.source}: rate_hz", rate)

    @cached_property
    def _path(self) -> Path:
        return Path(self.source).expanduser()

    @cached_property
    def source_camera(self) -> Camera:
        """The camera of the source's images, as the file has it."""
        cameras = {camera.name: camera for camera in load_cameras(Path(self.camera).expanduser())}
        if self.which is not None and self.which not in cameras:
            raise InputError(f"{self.camera}: no camera called {self.which!r}, expected one of {', '.join(cameras)}")
        return next(iter(cameras.values())) if self.which is None else cameras[self.which]

    @cached_property
    def last(self) -> int:
        """The number of the last frame used."""
        last = None if self.n_frames is None else self.first_frame + self.n_frames - 1
        n = count_frames(self._path, None if last is None else last + 1)
        wanted = self.first_frame if last is None else last
        if n == 0:
            raise InputError(f"{self.source}: expected frames, found none that can be decoded")
        if wanted >= n:
            raise InputError(f"{self.source}: no frame {wanted}, expected one of 0 to {n - 1}")
        return n - 1 if last is None else wanted

    @cached_property
    def _keypoints(self) -> Marks | None:
        return None if self.keypoints is None else _held(self._read(self.keypoints), self.held_out, False)

    @cached_property
    def _truth(self) -> Marks | None:
        """Marks for the evaluation, of the frames held out alone where there are some."""
        if self.eval_marks is None:
            return None
        return _held(self._read(self.eval_marks), self.held_out, bool(self.held_out))

    def _read(self, path: str) -> Marks:
        return read_marks(path, self.person, self.true_rate_hz, (self.first_frame, self.last))

    def _scaled(self, image: ByteArray) -> ByteArray:
        height, width = image.shape[:2]
        fx, fy = self.scale * self.source_camera.width / width, self.scale * self.source_camera.height / height
        if fx == fy == 1.0:
            return image
        # By factor, not by size, so that pixel centres land where Camera.scaled puts them.
        return np.asarray(cv2.resize(image, None, fx=fx, fy=fy, interpolation=cv2.INTER_AREA), np.uint8)

    def _first_marks(self) -> AnnotatedFrames | None:
        """The marks of the first frame and of those up to start_last, in the resized image."""
        if self.initial_annotations is None:
            return None
        marks, first = read_marks(self.initial_annotations), self.first_frame
        last = first if self.start_last is None else self.start_last
        if last < first:
            raise InputError(f"video: expected start_last of at least first_frame, {first}, found {last}")
        if first not in marks.frames:
            frames = ", ".join(map(str, marks.frames))
            raise InputError(f"{marks.source}: no marks in frame {first}, where the video starts; in {frames}")
        used = [int(index) for index in marks.frames if first <= index <= last]
        times_s = np.array(used) / self.true_rate_hz
        return AnnotatedFrames(times_s, np.array([self.scaled_marks(marks, index) for index in used]))

    def scaled_marks(self, marks: Marks | None, index: int) -> FloatArray | None:
        """Return the weighted marks (J, 3) of a frame in the resized image, where there are any."""
        found = None if marks is None else marks.weighted(index, self.hidden_weight)
        return None if found is None else np.column_stack([_resized(found[:, :2], self.scale), found[:, 2]])

    def _check_size(self, image: ByteArray) -> None:
        (height, width), camera = image.shape[:2], self.source_camera
        if max(abs(width / camera.width - 1.0), abs(height / camera.height - 1.0)) > _MOST_STRETCHED:
            expected = f"{camera.width}×{camera.height} of camera {camera.name!r}"
            raise InputError(f"{self.source}: images are {width}×{height}, expected the {expected}")


def _held(marks: Marks, held_out: Sequence[int], wanted: bool) -> Marks:
    """The marks of the frames held out, or without these."""
    if missing := set(held_out) - set(marks.frames.tolist()):
        raise InputError(f"{marks.source}: no marks in frame {min(missing)}, which is held out")
    return marks.rows(np.isin(marks.frames, list(held_out)) == wanted)


def _resized(pixels: FloatArray, scale: float) -> FloatArray:
    """Pixels of the full-size image in the resized one, as `Camera.scaled` moves them."""
    return (pixels + 0.5) * scale - 0.5
