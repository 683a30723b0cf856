"""Several videos of one person, seen at the same time by calibrated cameras."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame, Truth
from workbench.datasets.video import Video
from workbench.errors import InputError
from workbench.mocap.marker_files import read_markers
from workbench.mocap.markers import NO_MARKERS, MarkersOf, joint_centres

Files = Mapping[str, str]
NO_FILES: Files = MappingProxyType({})
NOBODY: Mapping[str, int] = MappingProxyType({})


class MultiView:
    """Videos that start together, one view each in every frame, with what a detector found in them.

    sources: videos or folders of images by the names of their cameras in the file `camera`. which: the names of those
    used, in this order; all by default. keypoints: a file of marks or folder of OpenPose's JSON by camera, for some or
    all of them; person: whom to follow there, by camera, where that is not the largest and surest, see `read_openpose`.
    first_frame, last_frame, scale, rate_hz: as for `Video`, the same for all. truth: a TRC or C3D file with markers,
    whose first frame is the sources' frame truth_first; joint_markers: markers in whose middle a joint lies, by joint,
    where their names do not say so. Axes, unit and gaps: see `markers.in_world`.

    Raises InputError for what `Video` and `read_markers` refuse, names that are no cameras, sources of different rates
    and a truth that has none of the frames.
    """

    def __init__(
        self,
        sources: Files,
        camera: str,
        which: Sequence[str] | None = None,
        first_frame: int = 0,
        last_frame: int | None = None,
        scale: float = 1.0,
        rate_hz: float | None = None,
        keypoints: Files = NO_FILES,
        person: Mapping[str, int] = NOBODY,
        truth: str | None = None,
        truth_first: int = 0,
        joint_markers: MarkersOf = NO_MARKERS,
    ) -> None:
        names = list(sources) if which is None else list(which)
        if unknown := [name for name in (*names, *keypoints, *person) if name not in sources]:
            raise InputError(f"multi_view: no source for camera {unknown[0]!r}, expected one of {', '.join(sources)}")
        if not names or len(set(names)) < len(names):
            raise InputError(f"multi_view: expected one camera or more, each once, found {', '.join(names) or 'none'}")
        self.videos = [
            Video(
                sources[name], camera, name, first_frame, last_frame, scale, rate_hz,
                keypoints=keypoints.get(name), person=person.get(name),
            )
            for name in names
        ]  # fmt: skip
        if len({video.rate_hz for video in self.videos}) > 1:
            rates = ", ".join(f"{video.rate_hz:g}" for video in self.videos)
            raise InputError(f"multi_view: expected sources of one rate, found {rates} Hz")
        self.scale = scale
        self._places = None if truth is None else self._true_joints(truth, truth_first, joint_markers)

    @property
    def name(self) -> str:
        """The names of the cameras used."""
        return ", ".join(video.camera.name for video in self.videos)

    @property
    def shape(self) -> None:
        """The person's measurements are not known."""
        return None

    @property
    def start_pose(self) -> None:
        """The true pose is not known."""
        return None

    @property
    def start_marks(self) -> None:
        """Nothing is marked by hand."""
        return None

    def __len__(self) -> int:
        return min(len(video) for video in self.videos)  # the shortest ends it for all

    def frames(self) -> Iterator[Frame]:
        """The frames in order, decoded one by one, as many as the shortest source has."""
        together = zip(*(video.frames() for video in self.videos), strict=False)
        for i, seen in enumerate(islice(together, len(self))):
            truth = None if self._places is None else Truth(joints=self._places[i])
            yield replace(seen[0], views=tuple(view for one in seen for view in one.views), truth=truth)

    def _true_joints(self, file: str, first: int, given: MarkersOf) -> FloatArray:
        """Joints (F, J, 3), m, of the markers in every frame."""
        markers, video = read_markers(Path(file)), self.videos[0]
        times_s = (video.first_frame - first + np.arange(len(self))) / video.rate_hz
        centres = joint_centres(markers, markers.at(times_s), given)
        if not np.isfinite(centres).any():
            raise InputError(f"{file}: expected markers in some of the {len(self)} frames used, found none")
        return centres
