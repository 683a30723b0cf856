"""Dataset of synchronized videos of one person in several calibrated cameras."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice, repeat
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.calibration import camera_named, fitted, in_units, read_calibration, unit_of_people
from workbench.cameras.camera import Camera
from workbench.cameras.camera_file import stated_unit
from workbench.core.capabilities import IMAGES, KEYPOINTS, START, Traits, component_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View
from workbench.datasets.truth_axes import in_axes_of_cameras
from workbench.datasets.video import Video
from workbench.datasets.visible_frames import visible_frames
from workbench.detections.association.isolated_joints import without_isolated
from workbench.detections.association.target_selection import most_prominent, select_target
from workbench.detections.detector.detection_files import DETECT, cached_detections
from workbench.detections.joint_annotations import JointAnnotations, target_annotations
from workbench.detections.readers.keypoint_files import is_detections
from workbench.detections.readers.people import People, SourceImages, read_people
from workbench.detections.synchronization import PairedFrames, at_times, estimated_offsets, paired_by_time, people_at
from workbench.motion.formats.markers import NO_MARKERS, MarkersOf, joint_centres, read_markers
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.frame_times import FrameTimes, is_equal
from workbench.utils.input_path import InputPath, expanded

log = logging.getLogger(__name__)

Files = Mapping[str, InputPath]
_NO_FILES: Files = MappingProxyType({})


class MultiView:
    """Videos of the same time, with one view per video in every frame, and their detections.

    Frames of the same number belong together where all cameras have the same times; else frames are those of the first
    camera, with the nearest images of the others and their keypoints interpolated between frames. Raises InputError for
    unknown cameras. `info` does as `Video` and `read_markers` do, for sources without a common time and for a truth
    without any of the frames.

    Parameters
    ----------
    sources : videos or folders of images by the names of their cameras.
    calibration_file : camera file, see `load_cameras`.
    cameras : names of the cameras used, in this order; None: all.
    first_frame, n_frames, scale, rate_hz : as for `Video`, the same for all.
    keypoints : annotation file or folder of OpenPose's JSON by camera, for some or all of them; "detect", for a camera
        or for all, to detect people by `detector`.
    person : target in the folders: an index in the first frame, of those used, in which the first of their cameras has
        a detection, or {camera: index}; None and "moving": see `select_target`.
    truth : TRC or C3D file with markers, or our own CSV of joints; gaps: see `markers.in_world`.
    truth_unit, truth_up, truth_forward : unit of length of the truth, m, cm, mm or inch, and its axes that are the
        world's z and x, e.g. y and -z; None: by the file, the person (`markers.in_world`) and the detections
        (`truth_axes.in_axes_of_cameras`).
    truth_first_frame : frame of the sources that corresponds to the truth's first.
    joint_markers : markers whose mean is a joint, by joint, where their names do not identify them.
    detector, cache : as for `Video`.
    only_visible : as for `Video`, where no camera has annotations; a person is visible in a frame that has a detection
        in any camera.
    unit : of lengths in calibration_file, as for `Video`; None: that of its format, or else that in which a person has
        a plausible height.
    up, keypoint_layout : as for `Video`; the layout is the same for all cameras.
    offsets_s : seconds by which cameras began later than the others, by their names, 0 for those without; None: they
        are estimated from the rays to the people, see `estimated_offsets`.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images, and keypoints where they are set."""
        keypoints = (KEYPOINTS, START) if keys.get("keypoints") else ()
        return component_traits(IMAGES, *keypoints)

    def __init__(
        self, sources: Files, calibration_file: InputPath, cameras: Sequence[str] | None = None, first_frame: int = 0,
        n_frames: int | None = None, scale: float = 1.0, rate_hz: float | None = None,
        keypoints: Files | str = _NO_FILES, person: int | str | Mapping[str, int] | None = None,
        truth: InputPath | None = None, truth_first_frame: int = 0, truth_unit: str | None = None,
        truth_up: str | None = None, truth_forward: str | None = None,
        joint_markers: MarkersOf = NO_MARKERS, detector: str = "full", cache: str = "~/.cache/workbench",
        only_visible: bool = False, unit: str | float | None = None, up: str | None = None,
        keypoint_layout: str | None = None, offsets_s: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        names = list(sources) if cameras is None else list(cameras)
        if isinstance(keypoints, str):
            if keypoints != DETECT:
                raise InputError(f"multi_view: keypoints: expected files by camera or {DETECT!r}, found {keypoints!r}")
            keypoints = dict.fromkeys(names, DETECT)
        if unknown := [name for name in (*names, *keypoints, *(offsets_s or ())) if name not in sources]:
            raise InputError(f"multi_view: no source for camera {unknown[0]!r}, expected one of {', '.join(sources)}")
        if not names or len(set(names)) < len(names):
            raise InputError(f"multi_view: expected one camera or more, each once, found {', '.join(names) or 'none'}")
        common = (first_frame, n_frames, scale, rate_hz)
        chosen = {name: keypoints[name] for name in names if name in keypoints}
        folders = {name: place for name, place in chosen.items() if place == DETECT or is_detections(place)}
        annotation_files = {name: file for name, file in keypoints.items() if name not in folders}
        files = [(sources[name], name, annotation_files.get(name)) for name in names]
        self._sources = [Video(source, calibration_file, name, *common, keypoints=file) for source, name, file in files]
        self._names, self._folders, self._person = names, folders, person
        self._detector, self._cache, self._only_visible = detector, Path(cache), only_visible
        self._truth, self._truth_first_frame, self._joint_markers = truth, truth_first_frame, joint_markers
        self._truth_axes = (truth_unit, truth_up, truth_forward)
        self._calibration = (calibration_file, unit, up)
        self._keypoint_layout, self._given_offsets_s = keypoint_layout, offsets_s

    @cached_property
    def info(self) -> SequenceInfo:
        """Metadata of all videos, up to the end of the shortest."""
        infos = [video.info for video in self._videos]
        _ = self._true_joints  # read now, so that errors are raised before the first frame
        return SequenceInfo(
            name=", ".join(one.cameras[0].name for one in infos), n_frames=len(self._used_rows),
            rate_hz=self._videos[0].times.rate_hz,
            source_rate_hz=next((one.source_rate_hz for one in infos if one.source_rate_hz is not None), None),
            cameras=tuple(one.cameras[0] for one in infos), scale=infos[0].scale,
            has_keypoints=any(one.has_keypoints for one in infos) or bool(self._target),
            input_counts={**self._counts, **self._repetitions},
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, decoded one by one, up to the end of the shortest source."""
        return self._synchronized([video.frames() for video in self._videos])

    def frames_without_images(self) -> Iterator[Frame]:
        """Yield the frames in order with empty images, without decoding them."""
        return self._synchronized([video.frames_without_images() for video in self._videos])

    def _synchronized(self, streams: Sequence[Iterator[Frame]]) -> Iterator[Frame]:
        """Yield the frames of all videos' frames at the same time."""
        if self._paired is not None:
            streams = [_frames_numbered(*each) for each in zip(streams, self._paired, strict=True)]
        synchronized = islice(zip(*streams, strict=False), len(self._frame_numbers))
        times_s, used = self._times_s, set(self._used_rows.tolist())
        for i, frames in enumerate(synchronized):
            if i not in used:
                continue
            truth = None if self._true_joints is None else Truth(joints=self._true_joints[i])
            views = tuple(self._with_keypoints(view, frames[0].index) for one in frames for view in one.views)
            yield replace(frames[0], time_s=float(times_s[i]), views=views, truth=truth)

    def _with_keypoints(self, view: View, index: int) -> View:
        """Return a view with the target's detections in its folder."""
        if (joints := self._target.get(view.camera.name)) is None:
            return view
        video = self._videos[self._names.index(view.camera.name)]
        keypoints, world = video.scaled_annotations(joints, index), joints.world_landmarks_at(index)
        return replace(view, keypoints=keypoints, world_landmarks=world, feet=video.scaled_feet(joints, index))

    @cached_property
    def _target(self) -> Mapping[str, JointAnnotations]:
        """Detections of the target by camera, at the frames and times of the first."""
        if not self._folders:
            return {}
        detections = self._people
        if self._paired is not None:
            pairs = dict(zip(self._names, self._paired, strict=True))
            detections = {
                name: people_at(people, pairs[name].frames, self._frame_numbers) for name, people in detections.items()
            }
        cameras = {name: self._cameras[name] for name in detections}
        times, within = self._times, (int(self._frame_numbers[0]), int(self._frame_numbers[-1]))
        target = select_target(detections, cameras, times.rate_hz, self._person, within, times.uneven_s, self._cuts)
        if self._paired is not None:
            rows = np.searchsorted(self._frame_numbers, target.frames)
            joint_times_s = [pairs[name].times_s[rows] for name in detections]
            resampled = map(at_times, target.joints, joint_times_s, repeat(self._times_s[rows]))
            target = replace(target, joints=np.stack(list(resampled)))
        return {name: target_annotations(detections[name], target, view) for view, name in enumerate(detections)}

    @property
    def _counts(self) -> Mapping[str, int]:
        """Counts of the people detected, see `TargetPerson`; none without detections."""
        return next((joints.counts for joints in self._target.values()), {})

    @property
    def _repetitions(self) -> dict[str, int]:
        """The largest counts of repeated images of any camera with detections, see `Video.repetitions`."""
        counts = dict[str, int]()
        for v, (name, video) in enumerate(zip(self._names, self._videos, strict=True)):
            frames = self._frame_numbers if self._paired is None else np.array(self._paired[v].frames)
            in_view = video.repetitions(frames[self._used_rows]) if name in self._folders else {}
            counts |= {kind: max(n, counts.get(kind, 0)) for kind, n in in_view.items()}
        return counts

    @property
    def _cuts(self) -> list[int]:
        """Numbers of the first camera's frames that begin another part of the video of any camera with detections."""
        cuts = set[int]()
        for v, (name, video) in enumerate(zip(self._names, self._videos, strict=True)):
            if name in self._folders and self._paired is None:
                cuts |= set(video.cuts)
            elif name in self._folders and self._paired is not None:
                rows = np.searchsorted(self._paired[v].frames, video.cuts)
                cuts |= set(self._frame_numbers[rows[rows < len(self._frame_numbers)]].tolist())
        return sorted(cuts)

    @cached_property
    def _people(self) -> Mapping[str, People]:
        """All people detected by camera."""
        videos = dict(zip(self._names, self._sources, strict=True))
        paths = {
            name: cached_detections(videos[name].path, self._detector, self._cache) if folder == DETECT else folder
            for name, folder in self._folders.items()
        }
        images = {
            name: SourceImages(videos[name].image_size) if folder == DETECT else videos[name].source_images
            for name, folder in self._folders.items()
        }
        detected = {name: str(videos[name].path) for name, folder in self._folders.items() if folder == DETECT}
        people = read_people(paths, images, self._keypoint_layout, detected)
        return {name: without_isolated(each, videos[name].times.rate_hz) for name, each in people.items()}

    @cached_property
    def _cameras(self) -> Mapping[str, Camera]:
        """Cameras of the sources' images, in metres with z up."""
        file, unit, up = self._calibration
        sizes = {name: video.image_size for name, video in zip(self._names, self._sources, strict=True)}
        if unit is None and stated_unit(expanded(file)) is None and len(self._folders) > 1:
            in_file = read_calibration(file, 1.0, "z")
            views = [in_units(camera_named(in_file, name, file), sizes[name]) for name in self._people]
            unit = unit_of_people(views, most_prominent(self._people.values()), file)
        cameras = read_calibration(file, unit, up)
        return {name: fitted(camera_named(cameras, name, file), sizes[name], name) for name in self._names}

    @cached_property
    def _videos(self) -> Sequence[Video]:
        """The sources with their cameras; all frames of all but the first where they are paired by time."""
        for video, name in zip(self._sources, self._names, strict=True):
            video.source_camera, video.motion = self._cameras[name], None
        if len(self._sources) > 1:
            log.info("cameras: taken as static, their motion is not measured")
        if not any(self._offsets_s.values()) and all(is_equal(self._times, video.times) for video in self._sources):
            return self._sources
        others = [replace(video, first_frame=0, n_frames=None) for video in self._sources[1:]]
        for video, name in zip(others, self._names[1:], strict=True):
            video.source_camera, video.motion = self._cameras[name], None
        return [self._sources[0], *others]

    @property
    def _times(self) -> FrameTimes:
        """Times of the first source's frames, without its offset."""
        return self._sources[0].times

    @cached_property
    def _offsets_s(self) -> Mapping[str, float]:
        """Seconds by which cameras began later than the others, given or else estimated from the people."""
        if self._given_offsets_s is not None:
            return dict(self._given_offsets_s)
        if len(self._folders) < 2:
            return {}
        times = {name: video.times for name, video in zip(self._names, self._sources, strict=True)}
        offsets_s = estimated_offsets(self._people, self._cameras, times)
        if offsets_s:
            listed = ", ".join(f"{name}: {offset:.3f}" for name, offset in offsets_s.items())
            log.warning("cameras began late by their keypoints, which is corrected: dataset.offsets_s={%s}", listed)
        return offsets_s

    @cached_property
    def _paired(self) -> Sequence[PairedFrames] | None:
        return self._pairing[1]

    @cached_property
    def _frame_numbers(self) -> IntArray:
        """Numbers of the frames of the first camera that are used."""
        return self._pairing[0]

    @cached_property
    def _pairing(self) -> tuple[IntArray, Sequence[PairedFrames] | None]:
        """Numbers of the first camera's frames, and all cameras' frames at these times, None for the same numbers."""
        videos = self._videos
        if videos is self._sources:
            n_frames = min(video.last - video.first + 1 for video in videos)
            return videos[0].first + np.arange(n_frames), None
        frames = np.arange(videos[0].first, videos[0].last + 1)
        offsets_s = [self._offsets_s.get(name, 0.0) for name in self._names]
        reference_s = self._times.at(frames) + offsets_s[0]
        sources = [(video.times, video.last + 1, offset) for video, offset in zip(videos, offsets_s, strict=True)]
        rows, paired = paired_by_time(reference_s, sources)
        if not len(rows):
            raise InputError(
                f"multi_view: expected times with frames of all cameras, found none: offsets {offsets_s} s"
            )
        late_ms = 1e3 * max(np.abs(each.times_s - reference_s[rows]).max() for each in paired)
        log.warning(
            "cameras are paired by time, %d frames of %s: keypoints are interpolated between frames, images are up to "
            "%.1f ms off", len(rows), self._names[0], late_ms,
        )  # fmt: skip
        return frames[rows], paired

    @property
    def _times_s(self) -> FloatArray:
        """Times of the frames, s."""
        offset_s = self._offsets_s.get(self._names[0], 0.0)
        return self._times.at(self._frame_numbers) + offset_s

    @cached_property
    def _used_rows(self) -> IntArray:
        """Rows of `_frame_numbers` that are used: all, or those in which the person is visible, between two cuts."""
        numbers = self._frame_numbers
        span = self._counts.get("part_first", int(numbers[0])), self._counts.get("part_last", int(numbers[-1]))
        if not self._only_visible or not self._target or any(video.keypoints for video in self._sources):
            return np.flatnonzero((numbers >= span[0]) & (numbers <= span[1]))
        detected = np.unique(np.concatenate([joints.detected_frames for joints in self._target.values()]))
        visible = visible_frames(", ".join(self._names), detected, span, self._times.rate_hz)
        return np.flatnonzero(np.isin(numbers, visible))

    @cached_property
    def _true_joints(self) -> FloatArray | None:
        """Joints (F, J, 3), m, from the markers in every frame."""
        if self._truth is None:
            return None
        markers, numbers = read_markers(Path(self._truth), *self._truth_axes), self._frame_numbers
        times_s = self._times.since(self._truth_first_frame, numbers)
        times_s = times_s + self._offsets_s.get(self._names[0], 0.0)
        centres = joint_centres(markers, markers.at(times_s), self._joint_markers)
        if not np.isfinite(centres).any():
            raise InputError(f"{self._truth}: expected markers in some of the {len(numbers)} frames used, found none")
        if any(self._truth_axes[1:]):
            return centres
        detections = [self._pixels(name, joints) for name, joints in self._target.items()]
        return in_axes_of_cameras(self._truth, centres, detections)

    def _pixels(self, name: str, joints: JointAnnotations) -> tuple[Camera, FloatArray]:
        """Return a camera and the target's detections (F, J, 2), NaN where missing."""
        detected = [joints.weighted(int(frame), 0.0) for frame in self._frame_numbers]
        gap = np.full((len(JOINT_NAMES), 2), np.nan)
        pixels = np.stack([gap if each is None else each[:, :2] for each in detected])
        return self._cameras[name], pixels


def _frames_numbered(frames: Iterator[Frame], paired: PairedFrames) -> Iterator[Frame]:
    """Yield the frames of a video with non-decreasing numbers."""
    frame = next(frames)
    for number in paired.frames:
        while frame.index < number:
            frame = next(frames)
        yield frame
