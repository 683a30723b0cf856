"""Dataset of a video file or image folder of a calibrated camera, with annotated or detected joints."""

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.background_tracks import track_background
from workbench.cameras.calibration import camera_named, fitted, read_calibration
from workbench.cameras.camera import Camera
from workbench.cameras.camera_file import load_lenses
from workbench.cameras.camera_motion import TURNING, CameraMotion, camera_motion
from workbench.cameras.image_changes import ImageChanges, frozen
from workbench.cameras.person_height import (
    HeightCalibration,
    Measurements,
    Segments,
    calibrate_by_height,
    detected_segments,
    head_foot_segments,
    in_image,
    pose_by_height,
)
from workbench.core.capabilities import ESTIMATED_CAMERA, IMAGES, KEYPOINTS, START, Traits, component_traits
from workbench.core.checks import UNIT, UP_TO_1, at_least, check, optional
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import NO_IMAGE, AnnotatedFrames, Frame, Truth, View
from workbench.core.side_information import HEIGHT, INITIAL_ANNOTATIONS
from workbench.datasets.visible_frames import visible_frames
from workbench.detections.association.target_selection import TrackedPeople, select_target, tracked_people
from workbench.detections.detector.detection_files import DETECT, cached_detections
from workbench.detections.joint_annotations import JointAnnotations, read_annotations, read_view, target_annotations
from workbench.detections.readers.keypoint_files import is_detections
from workbench.detections.readers.pairing import image_numbers
from workbench.detections.readers.people import People, SourceImages
from workbench.utils.arrays import ByteArray, FloatArray, IntArray
from workbench.utils.decode import (
    declared_frames,
    decode,
    file_version,
    image_files,
    image_shape,
    rotation_deg,
    timestamps,
)
from workbench.utils.errors import InputError
from workbench.utils.frame_times import FrameTimes, frame_times, given_times, rate_in_file
from workbench.utils.input_path import InputPath, expanded

log = logging.getLogger(__name__)

ADULT_M = 1.7
"""Assumed height of a person; adults' have a standard deviation of 0.1 m, which scales all distances."""
_GAIT, _STEP_S = 0.04, 0.5
"""See `Measurements.gait`, and the duration of a step."""
_MIN_SIZE_PX = 16
_MAX_STRETCH = 0.01
"""Maximum relative difference of image and camera size: encoders cut or pad to multiples of their blocks."""


@dataclass(eq=False)
class Video:
    """A video of one calibrated camera, with RGB images; everything in pixels follows their scale.

    Images that differ from the camera's size by up to 1 % are stretched to it, with a warning. With keypoints, a camera
    that turns or zooms is found by the background, see `camera_motion`: each frame has its own camera, and that of the
    calibration file is the camera of the first frame used. With detections, an edited film is split at its cuts, and
    the frames of the part with the target are used, see `ImageChanges`.

    Raises InputError for parameters out of range. `info` does for unreadable files, missing frames, images of another
    size, a missing frame rate, initial annotations without the first frame, and eval_frames without annotations.

    Parameters
    ----------
    source : a video file that OpenCV reads, or a folder of images in natural order (frame_9 before frame_10).
    calibration_file : camera file, see `load_cameras`; None: focal length, tilt and height of the camera are estimated
        from the heads and feet of the person in the keypoints, see `person_height`. Of a file without the camera's
        rotation and translation these are estimated in the same way.
    camera_name : name of a camera in it; None: the first.
    first_frame : number of the first frame used, counted from 0 in the source.
    n_frames : number of frames used; None: to the end.
    scale : factor by which images are resized.
    rate_hz : frame rate, where the source's is missing or wrong.
    initial_annotations : annotation file for the initialization, from first_frame and later frames up to
        initial_last_frame; None: first_frame alone.
    keypoints : annotation file, or folder of a detector's output (OpenPose's JSON), with the observed joints; "detect"
        to detect them by `detector`, once: the result is cached.
    eval_annotations : the same, with the ground truth of the evaluation.
    eval_frames : frames excluded from the keypoints; if any, eval_annotations is used in these frames alone.
    occluded_weight : weight of an annotation of an occluded joint relative to a visible one. It is 0.35 because
        occluded joints are annotated to 6–10 px, visible ones to 4. A detection's weight is its confidence.
    person : number of the target among the people in the frames that are set, in order of appearance, see
        `people_picture`; None: the largest and most confident one in the first frame with a detection; "moving": the
        most prominent one by size, visible time and motion.
    height_m : of the person, for a camera that is estimated; None: an adult's, ADULT_M.
    only_visible : omit the frames before and after the person is detected, and those in gaps longer than MAX_BRIDGE_S
        of `visible_frames`.
    detector : "full" or "heavy", BlazePose's models, which are downloaded once, or the path of a landmark model.
    cache : folder for detections and the model.
    unit : of lengths in calibration_file, m, cm, mm or a number of metres; None: that of its format, else m, or mm
        where only that is plausible.
    up : vertical axis of the world of calibration_file, such as y or -y; None: z.
    keypoint_layout : of a detector's points, such as BODY_25B; None: by their number and, where several layouts have
        it, by anatomy.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images of one camera, the keypoints and annotations that are set, and how the camera is known."""
        keypoints = () if keys.get("keypoints") is None else (KEYPOINTS, START)
        annotations = () if keys.get("initial_annotations") is None else (START, INITIAL_ANNOTATIONS)
        if _is_placed(keys.get("calibration_file")):
            return component_traits(IMAGES, *keypoints, *annotations)
        height = () if keys.get("height_m") is None else (HEIGHT,)
        return component_traits(IMAGES, ESTIMATED_CAMERA, *keypoints, *annotations, assumptions=height)

    source: InputPath
    calibration_file: InputPath | None
    camera_name: str | None = None
    first_frame: int = 0
    n_frames: int | None = None
    scale: float = 1.0
    rate_hz: float | None = None
    initial_annotations: InputPath | None = None
    initial_last_frame: int | None = None
    keypoints: InputPath | None = None
    eval_annotations: InputPath | None = None
    eval_frames: Sequence[int] = ()
    occluded_weight: float = 0.35
    person: int | str | None = None
    height_m: float | None = None
    only_visible: bool = False
    detector: str = "full"
    cache: str = "~/.cache/workbench"
    unit: str | float | None = None
    up: str | None = None
    keypoint_layout: str | None = None

    def __post_init__(self) -> None:
        check(
            "video", self, scale=UP_TO_1, occluded_weight=UNIT, first_frame=at_least(0), n_frames=optional(at_least(1))
        )

    @cached_property
    def info(self) -> SequenceInfo:
        """The camera of the resized images, and the annotations."""
        camera = self.source_camera
        if self.image_size != (camera.width, camera.height):
            size, expected = f"{self.image_size[0]}×{self.image_size[1]}", f"{camera.width}×{camera.height}"
            warnings.warn(f"{self.source}: images of {size} are stretched to the camera's {expected}", stacklevel=2)
        if min(camera.width, camera.height) * self.scale < _MIN_SIZE_PX:
            size = f"{camera.width * self.scale:.0f}×{camera.height * self.scale:.0f} px"
            raise InputError(f"video: scale {self.scale} leaves {size} of an image, expected at least {_MIN_SIZE_PX}")
        _ = self._truth  # read now, so that errors are raised before the first frame
        annotated = np.empty(0) if self._keypoints is None else self._keypoints.frames
        input_counts = {} if self._keypoints is None else self._keypoints.counts
        repetitions = {} if self._people is None else self.repetitions(self._used)
        return SequenceInfo(
            name=self.path.name, n_frames=len(self._used), rate_hz=self.times.rate_hz, scale=self.scale,
            source_rate_hz=None if self.rate_hz is None else rate_in_file(self.path, self._timestamps_s, self.rate_hz),
            cameras=(self.source_camera.scaled(self.scale),), initial_annotations=self._initial_annotations(),
            has_keypoints=bool(np.isin(annotated, self._used).any()), input_counts={**input_counts, **repetitions},
            camera_motion=None if self.motion is None else self.motion.kind,
            video=self.path if self._frames_are_images else None,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, decoded one by one, because seeking in a video file is unreliable."""
        index, used = self.first - 1, set(self._used.tolist())
        for index, image in enumerate(decode(self.path, self.first, self.last), self.first):
            if index in used:
                self._check_size(image)
                yield self._frame(index, self._scaled(image))
        if index < self.last:
            raise InputError(f"{self.source}: ends before frame {self.last}, which existed before")

    def frames_without_images(self) -> Iterator[Frame]:
        """Yield the frames in order with empty images, without decoding them."""
        return (self._frame(index, NO_IMAGE) for index in self._used.tolist())

    def _frame(self, index: int, image: ByteArray) -> Frame:
        (camera,) = self.info.cameras
        world = None if self._keypoints is None else self._keypoints.world_landmarks_at(index)
        seen_by = camera if self.motion is None else self.motion.camera(camera, 0, index - self.first)
        keypoints, feet = self.scaled_annotations(self._keypoints, index), self.scaled_feet(self._keypoints, index)
        annotated = None if self._truth is None else self._truth.at(index)
        truth = annotated and Truth(annotations=self._resized(annotated[0]), annotations_visible=annotated[1])
        return Frame(index, float(self.times.at(index)), (View(seen_by, image, keypoints, world, feet),), truth)

    @cached_property
    def motion(self) -> CameraMotion | None:
        """The motion of the camera from the first frame used to the last one; None without keypoints."""
        if self._background is None:
            return None
        camera = self.source_camera
        motion = self._background.at_focal(float(camera.matrix[0, 0]) / max(camera.width, camera.height))
        log.info("camera: %s", motion.sentence)
        return motion

    @cached_property
    def _background(self) -> CameraMotion | None:
        """The motion of the camera by the background, before the focal length is estimated from the person, too."""
        if self._keypoints is None or self.first == self.last:
            return None
        joints = dict(zip(self._keypoints.frames.tolist(), self._keypoints.pixels[:, None], strict=True))
        for people in ({} if self._people is None else self._people).values():
            joints = dict(zip(people.frames.tolist(), people.joints, strict=True))
        no_people = np.empty((0, len(JOINT_NAMES), 2))
        in_images = [joints.get(index, no_people) for index in range(self.first, self.last + 1)]
        images = decode(self.path, self.first, self.last)
        bar = tqdm(images, "background", len(in_images), leave=False, unit="frame", disable=None)
        return camera_motion(track_background(bar, in_images), self._lens)

    @property
    def _frames_are_images(self) -> bool:
        """Whether the source is an MP4 file whose frames are the images, also without undistortion."""
        size = self.source_camera.width, self.source_camera.height
        unscaled = self.scale == 1.0 and self.image_size == size and not self.source_camera.distortion.any()
        return unscaled and self.path.suffix.lower() == ".mp4" and rotation_deg(self.path) == 0.0

    @cached_property
    def times(self) -> FrameTimes:
        """Times of the source's frames: at rate_hz, or else of its timestamps."""
        if self.rate_hz is not None:
            return given_times(self.rate_hz)
        return frame_times(self.path, self._timestamps_s)

    @cached_property
    def _timestamps_s(self) -> FloatArray:
        """Timestamps of the source's frames up to the last one set, s; of a folder the numbers of its images."""
        if self.path.is_dir():
            return np.arange(len(image_files(self.path)), dtype=np.float64)
        return self._scanned[0]

    @cached_property
    def image_changes(self) -> ImageChanges:
        """Cuts and repeated images among the source's images up to the last one set."""
        if not self.path.is_dir():
            return self._scanned[1]
        changes = ImageChanges()
        for image in decode(self.path, 0, self._last):
            changes.add(image)
        return changes

    @property
    def _scanned(self) -> tuple[FloatArray, ImageChanges]:
        """Timestamps and changes of a video file's images up to the last one set."""
        at_most = None if self.n_frames is None else self.first_frame + self.n_frames
        return _times_and_changes(self.path, at_most, file_version(self.path))

    @cached_property
    def cuts(self) -> list[int]:
        """Numbers of the frames that begin another part of an edited film."""
        first, last = self._within
        cuts = [cut for cut in self.image_changes.cuts(self.times.rate_hz).tolist() if first < cut <= last]
        if cuts:
            listed = ", ".join(map(str, cuts))
            log.warning("%s: cuts at the frames %s: people are followed in each part by itself", self.path.name, listed)
        return cuts

    def repetitions(self, frames: IntArray) -> dict[str, int]:
        """Return in how many of some frames (M,) the image repeats the one before, and in how many for so long that the
        video is frozen; those of none are omitted."""
        repeated = self.image_changes.repeated()
        each = {"frames_repeated": repeated, "frames_frozen": frozen(repeated, self.times.rate_hz)}
        return {name: int(images[frames].sum()) for name, images in each.items() if images[frames].any()}

    @cached_property
    def path(self) -> Path:
        """The file or folder of the source."""
        return expanded(self.source)

    @cached_property
    def source_camera(self) -> Camera:
        """The camera of the source's images, in the first frame used if it moves."""
        is_known = self._lens is not None and _is_placed(self.calibration_file)
        return self._lens if self._lens is not None and is_known else self._estimated_camera(self._lens)

    @cached_property
    def _lens(self) -> Camera | None:
        """The camera of the calibration file, of which only the lens is valid if the file has no poses."""
        if self.calibration_file is None:
            return None
        cameras = load_lenses(expanded(self.calibration_file))
        cameras = cameras or read_calibration(self.calibration_file, self.unit, self.up)
        return fitted(camera_named(cameras, self.camera_name, self.calibration_file), self.image_size, self.source)

    @cached_property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the first image, px."""
        _ = self._timestamps_s  # raises an error for a source without frames
        height, width = image_shape(self.path)[:2]
        return width, height

    @cached_property
    def source_images(self) -> SourceImages:
        """Size and numbers of the source's images, for detections of them."""
        if self.keypoints == DETECT:
            return SourceImages(self.image_size)
        if self.path.is_dir():
            return SourceImages(self.image_size, image_numbers(self.path))
        n_images = max(len(self._timestamps_s), 0 if self.n_frames is None else declared_frames(self.path))
        return SourceImages(self.image_size, np.arange(n_images))

    @property
    def first(self) -> int:
        """Number of the first frame used."""
        return int(self._used[0])

    @property
    def last(self) -> int:
        """Number of the last frame used."""
        return int(self._used[-1])

    @cached_property
    def _used(self) -> IntArray:
        """Numbers of the frames used, increasing."""
        counts = {} if self._people is None or self._detected is None else self._detected.counts
        span = counts.get("part_first", self.first_frame), counts.get("part_last", self._last)
        if not self.only_visible or self._detected is None:
            return np.arange(span[0], span[1] + 1)
        detected = self._detected.detected_frames
        if self._detected.confidence is None:  # a person is visible between two annotated frames
            detected = np.arange(detected[0], detected[-1] + 1)
        return visible_frames(self.path.name, detected, span, self.times.rate_hz)

    @cached_property
    def _last(self) -> int:
        """Number of the last frame of those that are set."""
        last = None if self.n_frames is None else self.first_frame + self.n_frames - 1
        n = len(self._timestamps_s)
        last_needed = self.first_frame if last is None else last
        if last_needed >= n:
            raise InputError(f"{self.source}: no frame {last_needed}, expected one of 0 to {n - 1}")
        return n - 1 if last is None else last_needed

    @cached_property
    def _detected(self) -> JointAnnotations | None:
        """The person's annotated or detected joints in the frames that are set."""
        if self._people is None:
            return None if self.keypoints is None else self._read(self.keypoints)
        times = self.times
        target = select_target(self._people, None, times.rate_hz, self.person, self._within, times.uneven_s, self.cuts)
        return target_annotations(next(iter(self._people.values())), target, 0)

    @cached_property
    def _keypoints(self) -> JointAnnotations | None:
        return None if self._detected is None else _select_frames(self._detected, self.eval_frames, False)

    @cached_property
    def _truth(self) -> JointAnnotations | None:
        """Annotations for the evaluation, in eval_frames alone if any."""
        if self.eval_annotations is None:
            return None
        return _select_frames(self._read(self.eval_annotations), self.eval_frames, bool(self.eval_frames))

    @property
    def people(self) -> TrackedPeople | None:
        """All people detected in the frames that are set, with the numbers of `person`; None without detections."""
        if self._people is None:
            return None
        times = self.times
        return tracked_people(self._people, None, times.rate_hz, self._within, times.uneven_s, self.cuts)

    @cached_property
    def _people(self) -> Mapping[str, People] | None:
        """All people detected in the frames that are set, by the video's name; None without detections."""
        if self.keypoints is None or not (self.keypoints == DETECT or is_detections(self.keypoints)):
            return None
        path, video = self._file(self.keypoints)
        return read_view(Path(path), self._within, self.source_images, self.keypoint_layout, video)

    def _read(self, path: str) -> JointAnnotations:
        path, video = self._file(path)
        images, layout = self.source_images, self.keypoint_layout
        return read_annotations(path, self.person, self.times, self._within, images, layout, video)

    def _file(self, path: str) -> tuple[str, Path | None]:
        """Return a file or folder of joints, which are detected if the path is DETECT, and then the video."""
        if path != DETECT:
            return path, None
        return str(cached_detections(self.path, self.detector, Path(self.cache), self._within)), self.path

    @property
    def _within(self) -> tuple[int, int]:
        """Numbers of the first and the last frame that are set."""
        return self.first_frame, self._last

    def _estimated_camera(self, lens: Camera | None) -> Camera:
        """Return the camera estimated from the heads and feet of the person in the keypoints, with a known lens if
        there is one, in the first frame used."""
        if self._keypoints is None:
            raise InputError(
                f"{self.source}: expected dataset.calibration_file with the camera's rotation and translation, or "
                "dataset.keypoints to estimate the camera from"
            )
        height_m = ADULT_M if self.height_m is None else self.height_m
        joints = self._keypoints
        if joints.confidence is not None:
            joints = replace(joints, pixels=in_image(joints.pixels, self.image_size))
        measured = Measurements(height_m, gait=_GAIT, step_frames=_STEP_S * self.times.rate_hz)
        turning = None if self._background is None or self._background.kind != TURNING else self._background
        seen_by = lens
        if turning is not None:  # as if the camera had stood still in the middle of its directions
            joints = joints.select((joints.frames >= self.first) & (joints.frames <= self.last))
            pixels, seen_by = turning.in_middle(joints.frames - self.first, joints.pixels, lens)
            joints, focal_px = replace(joints, pixels=pixels), float(seen_by.matrix[0, 0])
            if lens is None:
                measured = replace(measured, focal_px=focal_px, focal_spread=turning.focal_spread)
        segments = _segments(joints)
        if lens is not None and seen_by is not None:
            estimate = pose_by_height(seen_by, segments, measured)
        else:
            estimate = calibrate_by_height("camera", self.image_size, segments, measured)
        self._report_camera(estimate, height_m, lens)
        return estimate.camera if turning is None else turning.in_first(estimate.camera, lens)

    def _report_camera(self, estimate: HeightCalibration, height_m: float, lens: Camera | None) -> None:
        """Log an estimated camera with its standard deviations, and what is assumed."""
        value, sigma = estimate.values, estimate.sigma
        assumed = " of an adult, which is assumed" if self.height_m is None else ""
        log.info(
            "camera estimated from the person's height, %.2f m%s%s: focal length %.0f ± %.0f px, tilt %.1f ± %.1f°, "
            "%.2f ± %.2f m above the floor", height_m, assumed,
            "" if lens is None else f", with the lens of {self.calibration_file}", value["focal_px"], sigma["focal_px"],
            value["tilt_deg"], sigma["tilt_deg"], value["height_m"], sigma["height_m"],
        )  # fmt: skip
        if not estimate.frames:
            log.info("no frame shows the person from head to feet: a level camera at a usual height is assumed")

    def _scaled(self, image: ByteArray) -> ByteArray:
        height, width = image.shape[:2]
        fx, fy = self.scale * self.source_camera.width / width, self.scale * self.source_camera.height / height
        if fx == fy == 1.0:
            return image
        # by factor, not by size, so that pixel centres agree with Camera.scaled
        return np.asarray(cv2.resize(image, None, fx=fx, fy=fy, interpolation=cv2.INTER_AREA), np.uint8)

    def _initial_annotations(self) -> AnnotatedFrames | None:
        """Return the annotations from first_frame to initial_last_frame in the resized image."""
        if self.initial_annotations is None:
            return None
        annotations, first = read_annotations(self.initial_annotations), self.first
        last = first if self.initial_last_frame is None else self.initial_last_frame
        if last < first:
            raise InputError(f"video: expected initial_last_frame of at least first_frame={first}, found {last}")
        if first not in annotations.frames:
            frames = ", ".join(map(str, annotations.frames))
            expected = f"expected annotations in first_frame={first}, found them in frames {frames}"
            raise InputError(f"{annotations.source}: {expected}")
        used = [int(index) for index in annotations.frames if first <= index <= last]
        times_s = self.times.at(np.array(used))
        return AnnotatedFrames(times_s, np.array([self.scaled_annotations(annotations, index) for index in used]))

    def scaled_annotations(self, annotations: JointAnnotations | None, index: int) -> FloatArray | None:
        """Return the weighted annotations (J, 3) of a frame in the resized image; None without any."""
        weighted = None if annotations is None else annotations.weighted(index, self.occluded_weight)
        return None if weighted is None else np.column_stack([self._resized(weighted[:, :2]), weighted[:, 2]])

    def scaled_feet(self, annotations: JointAnnotations | None, index: int) -> FloatArray | None:
        """Return the ends of the feet (4, 3) of a frame in the resized image; None without any."""
        feet = None if annotations is None else annotations.feet_at(index)
        return None if feet is None else np.column_stack([self._resized(feet[:, :2]), feet[:, 2]])

    def _resized(self, pixels: FloatArray) -> FloatArray:
        """Return pixels of the full-size image in the resized one, as `Camera.scaled` does."""
        return (pixels + 0.5) * self.scale - 0.5

    def _check_size(self, image: ByteArray) -> None:
        (height, width), camera = image.shape[:2], self.source_camera
        if max(abs(width / camera.width - 1.0), abs(height / camera.height - 1.0)) > _MAX_STRETCH:
            expected = f"{camera.width}×{camera.height} of camera {camera.name!r}"
            raise InputError(f"{self.source}: images are {width}×{height}, expected the {expected}")


@lru_cache(maxsize=8)
def _times_and_changes(path: Path, at_most: int | None, _version: object) -> tuple[FloatArray, ImageChanges]:
    """Return the timestamps of a video file's first images, and their changes, decoded once for all datasets of it.

    _version : of the file's content.
    """
    changes = ImageChanges()
    return timestamps(path, at_most, changes.add), changes


def _segments(joints: JointAnnotations) -> Segments:
    """Return the head–foot segments for a camera that is estimated."""
    if joints.confidence is None:
        return head_foot_segments(joints.frames, joints.pixels, joints.source)
    return detected_segments(joints.frames, joints.pixels, joints.confidence, joints.world_landmarks)


def _is_placed(calibration_file: str | None) -> bool:
    """Return whether a calibration file gives the camera's pose; also of a file that cannot be read, an error later."""
    if calibration_file is None:
        return False
    try:
        return not load_lenses(expanded(calibration_file))
    except InputError:
        return True


def _select_frames(annotations: JointAnnotations, frames: Sequence[int], included: bool) -> JointAnnotations:
    """Return the annotations of the frames `included`, or of all others; raises InputError for a frame without any."""
    if missing := set(frames) - set(annotations.frames.tolist()):
        raise InputError(
            f"{annotations.source}: eval_frames: expected annotated frames, found {min(missing)} without annotations"
        )
    return annotations.select(np.isin(annotations.frames, list(frames)) == included)
