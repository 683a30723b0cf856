"""Points out of files: one file a frame, or all frames in one."""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.core.capabilities import POINTS, START, Traits, component_traits
from workbench.core.checks import RATE, at_least, check, one_of
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.datasets.files import natural_order
from workbench.datasets.files.point_formats import READERS, read_hdf5
from workbench.datasets.rendering.sequence import Scene, Take, find_take, given_start, offered_start
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_places
from workbench.utils.rng import stream

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(eq=False)
class PointFiles:
    """Frames of points in the world (z up), read from files once, when asked what is known.

    source: a folder of files, one a frame, all .ply, all .npz or all .csv, in natural order (frame_9 before frame_10);
    or one .h5 or .hdf5 file, see `point_formats.read_hdf5`. first_frame: the number of the first frame used, counted
    from 0. n_frames: how many are used; None: to the end. rate_hz: frames per second. unit: m, cm or mm. most_points:
    frames with more are thinned at random to so many, and a warning says so. truth: the name of a motion
    (`named.find_motion`; data: its folder) at rate_hz, whose first frame is the files' frame truth_first; it gives
    every frame its true pose, joints and activity, and the person's measurements. Without it nothing is known. start,
    seed: as for `points.Points`; start="given" needs the truth. The seed also says which points are kept. Raises
    InputError for numbers out of range and, when asked what is known, naming the file and the line, row or vertex, what
    was expected and what was found, for what cannot be read, a frame without points, numbers that are not finite, a
    folder without files of points and frames that are not there.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which tell the start, too, and what is given of it."""
        return component_traits(POINTS, START, *offered_start(keys))

    source: str
    rate_hz: float = 14.0
    unit: str = "m"
    most_points: int = 5000
    truth: Any = None  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    first_frame: int = 0
    n_frames: int | None = None
    truth_first: int = 0
    start: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        check("points", self, unit=one_of(*_METRES), rate_hz=RATE, most_points=at_least(1))
        check("points", self, first_frame=at_least(0), seed=at_least(0))
        if self.n_frames is not None and self.n_frames < 1:
            raise InputError(f"points: n_frames must be at least 1, found {self.n_frames}")
        if self.truth is not None and self.first_frame < self.truth_first:
            found = f"{self.first_frame} and {self.truth_first}"
            raise InputError(
                f"points: expected first_frame of at least truth_first, where the truth begins, found {found}"
            )

    @cached_property
    def info(self) -> SequenceInfo:
        """Tell how many frames there are; of the person what the truth says, and what is offered of the start."""
        initial_pose, phase_ends = given_start("points", self.start, self._take, self.seed)
        return SequenceInfo(
            name=self._path.name, n_frames=len(self._points), rate_hz=self.rate_hz,
            shape=self._take.motion.shape if self._take else None, initial_pose=initial_pose, has_points=True,
            phase_ends=phase_ends,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order, with their numbers in the source, without views."""
        for i, points in enumerate(self._points):
            index, truth = self.first_frame + i, None if self._take is None else self._take.truths[i]
            yield Frame(index, index / self.rate_hz, (), truth, points=points)

    @cached_property
    def _path(self) -> Path:
        return Path(self.source).expanduser()

    @cached_property
    def _take(self) -> Take | None:
        if self.truth is None:
            return None
        first = self.first_frame - self.truth_first
        shown: dict[str, Any] = {"n_frames": len(self._points), "first_frame": first, "exact": True}
        return find_take(Scene(motion=self.truth, data=self.data, rate_hz=self.rate_hz, seed=self.seed, **shown))

    @cached_property
    def _points(self) -> list[FloatArray]:
        """The points (K, 3) of every frame used, m."""
        clouds, thinned, n = [], [], 0
        end = None if self.n_frames is None else self.first_frame + self.n_frames
        for i, (name, points) in enumerate(islice(self._files(), end)):
            n = i + 1
            if i < self.first_frame:
                continue
            if len(points) > self.most_points:
                thinned.append(f"{name} with {len(points)}")
                rng = stream(self.seed, "thinning", i)
                points = points[np.sort(rng.choice(len(points), self.most_points, replace=False))]
            check_places(f"{self.source}: {name}", _METRES[self.unit] * points)
            clouds.append(_METRES[self.unit] * points)
        if n < (self.first_frame + 1 if end is None else end):
            raise InputError(f"{self.source}: no frame {max(n, self.first_frame)}, expected one of 0 to {n - 1}")
        if thinned:
            many = f"{len(thinned)} of {len(clouds)} frames have more than {self.most_points} points"
            words = f"{self.source}: {many} and are thinned at random to so many, the first being {thinned[0]}"
            warnings.warn(words, stacklevel=3)
        return clouds

    def _files(self) -> Iterator[tuple[str, FloatArray]]:
        """The name and the points (K, 3), in the file's unit, of every frame."""
        if self._path.is_file() and self._path.suffix.lower() in (".h5", ".hdf5"):
            for i, points in enumerate(read_hdf5(self._path)):
                yield f"frame {i}", points
            return
        if not self._path.is_dir():
            raise InputError(f"{self._path}: expected a folder with files of points, or an .h5 or .hdf5 file")
        files = [file for file in self._path.iterdir() if file.suffix.lower() in READERS]
        kinds = sorted({file.suffix.lower() for file in files})
        if len(kinds) != 1:
            found, readable = "files of several kinds, " + ", ".join(kinds) if kinds else "none", ", ".join(READERS)
            raise InputError(f"{self._path}: expected files of points of one kind ({readable}), found {found}")
        names = natural_order([file.name for file in files])
        for name in tqdm(names, desc=f"reading {self._path.name}", unit="frame", disable=None):
            yield name, READERS[kinds[0]](self._path / name)
