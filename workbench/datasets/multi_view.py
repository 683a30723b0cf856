"""Dataset of synchronized videos of one person in several calibrated cameras."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.capabilities import IMAGES, KEYPOINTS, ONE_CAMERA, START, Traits, component_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View
from workbench.core.keys import records_arguments
from workbench.datasets.association.target_selection import select_target
from workbench.datasets.detection.detection_files import DETECT, cached_detections
from workbench.datasets.files.joint_annotations import JointAnnotations, read_detections, target_annotations
from workbench.datasets.truth_axes import in_axes_of_cameras
from workbench.datasets.video import Video
from workbench.datasets.visible_frames import visible_frames
from workbench.motion.formats.markers import NO_MARKERS, MarkersOf, joint_centres, read_markers
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

Files = Mapping[str, str]
_NO_FILES: Files = MappingProxyType({})


@records_arguments
class MultiView:
    """Videos that start at the same time, with one view per video in every frame, and their detections.

    Raises InputError for unknown cameras. `info` does as `Video` and `read_markers` do, for sources of different rates
    and for a truth without any of the frames.

    Parameters
    ----------
    sources : videos or folders of images by the names of their cameras.
    calibration_file : camera file of the Pose2Sim and Sports2D form.
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
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images, keypoints where they are set, and whether there is a single camera."""
        keypoints = (KEYPOINTS, START) if keys.get("keypoints") else ()
        single = (ONE_CAMERA,) if len(keys.get("cameras") or keys.get("sources") or ()) == 1 else ()
        return component_traits(IMAGES, *single, *keypoints)

    def __init__(
        self, sources: Files, calibration_file: str, cameras: Sequence[str] | None = None, first_frame: int = 0,
        n_frames: int | None = None, scale: float = 1.0, rate_hz: float | None = None,
        keypoints: Files | str = _NO_FILES, person: int | str | Mapping[str, int] | None = None,
        truth: str | None = None, truth_first_frame: int = 0, truth_unit: str | None = None,
        truth_up: str | None = None, truth_forward: str | None = None,
        joint_markers: MarkersOf = NO_MARKERS, detector: str = "full", cache: str = "~/.cache/workbench",
        only_visible: bool = False,
    ) -> None:  # fmt: skip
        names = list(sources) if cameras is None else list(cameras)
        if isinstance(keypoints, str):
            if keypoints != DETECT:
                raise InputError(f"multi_view: keypoints: expected files by camera or {DETECT!r}, found {keypoints!r}")
            keypoints = dict.fromkeys(names, DETECT)
        if unknown := [name for name in (*names, *keypoints) if name not in sources]:
            raise InputError(f"multi_view: no source for camera {unknown[0]!r}, expected one of {', '.join(sources)}")
        if not names or len(set(names)) < len(names):
            raise InputError(f"multi_view: expected one camera or more, each once, found {', '.join(names) or 'none'}")
        common = (first_frame, n_frames, scale, rate_hz)
        chosen = {name: keypoints[name] for name in names if name in keypoints}
        folders = {name: place for name, place in chosen.items() if place == DETECT or Path(place).is_dir()}
        annotation_files = {name: file for name, file in keypoints.items() if name not in folders}
        files = [(sources[name], name, annotation_files.get(name)) for name in names]
        self._videos = [Video(source, calibration_file, name, *common, keypoints=file) for source, name, file in files]
        self._names, self._folders, self._person = names, folders, person
        self._detector, self._cache, self._only_visible = detector, Path(cache), only_visible
        self._truth, self._truth_first_frame, self._joint_markers = truth, truth_first_frame, joint_markers
        self._truth_axes = (truth_unit, truth_up, truth_forward)

    @cached_property
    def info(self) -> SequenceInfo:
        """Metadata of all videos, up to the end of the shortest."""
        infos = [video.info for video in self._videos]
        rates_hz = [video.true_rate_hz for video in self._videos]
        if len(set(rates_hz)) > 1:
            rates = ", ".join(f"{rate:g}" for rate in rates_hz)
            raise InputError(f"multi_view: expected sources of one rate, found {rates} Hz")
        _ = self._true_joints  # read now, so that errors are raised before the first frame
        return SequenceInfo(
            name=", ".join(one.cameras[0].name for one in infos), n_frames=len(self._used), rate_hz=rates_hz[0],
            source_rate_hz=next((one.source_rate_hz for one in infos if one.source_rate_hz is not None), None),
            cameras=tuple(one.cameras[0] for one in infos), scale=infos[0].scale,
            has_keypoints=any(one.has_keypoints for one in infos) or bool(self._target),
            input_counts=next((joints.counts for joints in self._target.values()), {}),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, decoded one by one, up to the end of the shortest source."""
        synchronized = zip(*(video.frames() for video in self._videos), strict=False)
        used = set(self._used.tolist())
        for i, frames in enumerate(islice(synchronized, self._n_frames)):
            if frames[0].index not in used:
                continue
            truth = None if self._true_joints is None else Truth(joints=self._true_joints[i])
            views = tuple(self._with_keypoints(view, frames[0].index) for one in frames for view in one.views)
            yield replace(frames[0], views=views, truth=truth)

    def _with_keypoints(self, view: View, index: int) -> View:
        """Return a view with the target's detections in its folder."""
        if (joints := self._target.get(view.camera.name)) is None:
            return view
        video = self._videos[self._names.index(view.camera.name)]
        keypoints, world = video.scaled_annotations(joints, index), joints.world_landmarks_at(index)
        return replace(view, keypoints=keypoints, world_landmarks=world)

    @cached_property
    def _target(self) -> Mapping[str, JointAnnotations]:
        """Detections of the target by camera."""
        if not self._folders:
            return {}
        videos = dict(zip(self._names, self._videos, strict=True))
        cameras = {name: videos[name].source_camera for name in self._folders}
        folders = {
            name: cached_detections(videos[name].path, self._detector, self._cache) if folder == DETECT else folder
            for name, folder in self._folders.items()
        }
        detections = {name: read_detections(folder) for name, folder in folders.items()}
        first = self._videos[0].first
        within = (first, first + self._n_frames - 1)
        target = select_target(detections, cameras, self._videos[0].true_rate_hz, self._person, within)
        return {name: target_annotations(detections[name], target, view) for view, name in enumerate(detections)}

    @property
    def _n_frames(self) -> int:
        return min(video.info.n_frames for video in self._videos)

    @cached_property
    def _used(self) -> IntArray:
        """Numbers of the frames used, increasing."""
        first, last = self._videos[0].first, self._videos[0].first + self._n_frames - 1
        if not self._only_visible or not self._target or any(video.keypoints for video in self._videos):
            return np.arange(first, last + 1)
        detected = np.unique(np.concatenate([joints.detected_frames for joints in self._target.values()]))
        return visible_frames(", ".join(self._names), detected, (first, last), self._videos[0].true_rate_hz)

    @cached_property
    def _true_joints(self) -> FloatArray | None:
        """Joints (F, J, 3), m, from the markers in every frame."""
        if self._truth is None:
            return None
        markers, video = read_markers(Path(self._truth), *self._truth_axes), self._videos[0]
        times_s = (video.first_frame - self._truth_first_frame + np.arange(self._n_frames)) / video.true_rate_hz
        centres = joint_centres(markers, markers.at(times_s), self._joint_markers)
        if not np.isfinite(centres).any():
            raise InputError(f"{self._truth}: expected markers in some of the {self._n_frames} frames used, found none")
        if any(self._truth_axes[1:]):
            return centres
        return in_axes_of_cameras(
            self._truth, centres, [self._pixels(name, joints) for name, joints in self._target.items()]
        )

    def _pixels(self, name: str, joints: JointAnnotations) -> tuple[Camera, FloatArray]:
        """Return a camera and the target's detections (F, J, 2) in the frames used, NaN where missing."""
        frames = self._videos[0].first_frame + np.arange(self._n_frames)
        found = [joints.weighted(int(frame), 0.0) for frame in frames]
        gap = np.full((len(JOINT_NAMES), 2), np.nan)
        pixels = np.stack([gap if each is None else each[:, :2] for each in found])
        return self._videos[self._names.index(name)].source_camera, pixels
