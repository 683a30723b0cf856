"""Several videos of one person, seen at the same time by calibrated cameras."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.core.capabilities import IMAGES, KEYPOINTS, ONE_CAMERA, START, Traits, component_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View
from workbench.core.keys import records_arguments
from workbench.datasets.association.target_selection import follow
from workbench.datasets.files.joint_annotations import Marks, followed_marks, read_people
from workbench.datasets.video import Video
from workbench.motion.formats.markers import NO_MARKERS, MarkersOf, joint_centres, read_markers
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

Files = Mapping[str, str]
_NO_FILES: Files = MappingProxyType({})


@records_arguments
class MultiView:
    """Videos that start together, one view each in every frame, with what a detector found in them.

    sources: videos or folders of images by the names of their cameras in the file `camera`. which: the names of those
    used, in this order; all by default. keypoints: a file of marks or folder of OpenPose's JSON by camera, for some or
    all of them. person: whom to follow in the folders, the number of somebody in the first frame, of those used, in
    which the first of their cameras shows anybody, or {camera: number} for others; None: the largest and surest, see
    `follow`.
    first_frame, n_frames, scale, rate_hz: as for `Video`, the same for all. truth: a TRC or C3D file with
    markers, whose first frame is the sources' frame truth_first; joint_markers: markers in whose middle a joint lies,
    by joint, where their names do not say so. Axes, unit and gaps: see `markers.in_world`. Raises InputError for names
    that are no cameras and, when asked what is known, for what `Video` and `read_markers` refuse, sources of different
    rates and a truth that has none of the frames.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images, the detected joints that are given, and whether one camera alone looks."""
        keypoints = (KEYPOINTS, START) if keys.get("keypoints") else ()
        single = (ONE_CAMERA,) if len(keys.get("which") or keys.get("sources") or ()) == 1 else ()
        return component_traits(IMAGES, *single, *keypoints)

    def __init__(
        self, sources: Files, camera: str, which: Sequence[str] | None = None, first_frame: int = 0,
        n_frames: int | None = None, scale: float = 1.0, rate_hz: float | None = None, keypoints: Files = _NO_FILES,
        person: int | Mapping[str, int] | None = None, truth: str | None = None, truth_first: int = 0,
        joint_markers: MarkersOf = NO_MARKERS,
    ) -> None:  # fmt: skip
        names = list(sources) if which is None else list(which)
        if unknown := [name for name in (*names, *keypoints) if name not in sources]:
            raise InputError(f"multi_view: no source for camera {unknown[0]!r}, expected one of {', '.join(sources)}")
        if not names or len(set(names)) < len(names):
            raise InputError(f"multi_view: expected one camera or more, each once, found {', '.join(names) or 'none'}")
        common = (first_frame, n_frames, scale, rate_hz)
        folders = {name: keypoints[name] for name in names if name in keypoints and Path(keypoints[name]).is_dir()}
        by_hand = {name: file for name, file in keypoints.items() if name not in folders}
        self._videos = [Video(sources[name], camera, name, *common, keypoints=by_hand.get(name)) for name in names]
        self._names, self._folders, self._person = names, folders, person
        self._truth, self._truth_first, self._joint_markers = truth, truth_first, joint_markers

    @cached_property
    def info(self) -> SequenceInfo:
        """Metadata of all the videos; the shortest ends it for all."""
        known = [video.info for video in self._videos]
        rates_hz = [video.true_rate_hz for video in self._videos]
        if len(set(rates_hz)) > 1:
            rates = ", ".join(f"{rate:g}" for rate in rates_hz)
            raise InputError(f"multi_view: expected sources of one rate, found {rates} Hz")
        _ = self._true_joints  # read now, so that mistakes show before the first frame
        return SequenceInfo(
            name=", ".join(one.cameras[0].name for one in known), n_frames=self._n_frames, rate_hz=rates_hz[0],
            source_rate_hz=next((one.source_rate_hz for one in known if one.source_rate_hz is not None), None),
            cameras=tuple(one.cameras[0] for one in known), scale=known[0].scale,
            has_keypoints=any(one.has_keypoints for one in known) or bool(self._followed),
            counted=next((marks.counted for marks in self._followed.values()), {}),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order, decoded one by one, as many as the shortest source has."""
        together = zip(*(video.frames() for video in self._videos), strict=False)
        for i, seen in enumerate(islice(together, self._n_frames)):
            truth = None if self._true_joints is None else Truth(joints=self._true_joints[i])
            views = tuple(self._marked(view, seen[0].index) for one in seen for view in one.views)
            yield replace(seen[0], views=views, truth=truth)

    def _marked(self, view: View, index: int) -> View:
        """Put into a view what its folder shows of the person followed."""
        if (marks := self._followed.get(view.camera.name)) is None:
            return view
        return replace(view, keypoints=self._videos[self._names.index(view.camera.name)].scaled_marks(marks, index))

    @cached_property
    def _followed(self) -> Mapping[str, Marks]:
        """What the folders show of one person, by camera."""
        if not self._folders:
            return {}
        videos = dict(zip(self._names, self._videos, strict=True))
        cameras = {name: videos[name].source_camera for name in self._folders}
        found = {name: read_people(folder) for name, folder in self._folders.items()}
        first = self._videos[0].first_frame
        within = (first, first + self._n_frames - 1)
        followed = follow(found, cameras, self._videos[0].true_rate_hz, self._person, within)
        return {name: followed_marks(found[name], followed, view) for view, name in enumerate(found)}

    @property
    def _n_frames(self) -> int:
        return min(video.info.n_frames for video in self._videos)

    @cached_property
    def _true_joints(self) -> FloatArray | None:
        """Joints (F, J, 3), m, of the markers in every frame."""
        if self._truth is None:
            return None
        markers, video = read_markers(Path(self._truth)), self._videos[0]
        times_s = (video.first_frame - self._truth_first + np.arange(self._n_frames)) / video.true_rate_hz
        centres = joint_centres(markers, markers.at(times_s), self._joint_markers)
        if not np.isfinite(centres).any():
            raise InputError(f"{self._truth}: expected markers in some of the {self._n_frames} frames used, found none")
        return centres
