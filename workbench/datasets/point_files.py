"""Points out of files: one file a frame, or all frames in one."""

import warnings
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.arrays import FloatArray
from workbench.body.shape import Shape
from workbench.datasets.frame import Frame
from workbench.datasets.point_formats import READERS, natural_order, read_hdf5
from workbench.datasets.take import Take, check_start, find_take
from workbench.errors import InputError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}


class PointFiles:
    """Frames of points in the world (z up), read from files once, at the beginning.

    source: a folder of files, one a frame, all .ply, all .npz or all .csv, in natural order (frame_9 before frame_10);
    or one .h5 or .hdf5 file, see `point_formats.read_hdf5`. rate_hz: frames per second. unit: m, cm or mm. most_points:
    frames with more are thinned at random to so many, and a warning says so. truth: the name of a motion
    (`motions.find_motion`; data: its folder), whose frames from first_frame on, at rate_hz, are those of the files;
    it gives every frame its true pose, joints and activity, and the person's measurements. Without it nothing is known.
    start, seed: as for `points.Points`; start="given" needs the truth. The seed also says which points are kept.

    Raises InputError, naming the file and the line, row or vertex, what was expected and what was found, for what
    cannot be read, a frame without points, numbers that are not finite, and a folder without files of points.
    """

    def __init__(
        self,
        source: str,
        rate_hz: float = 14.0,
        unit: str = "m",
        most_points: int = 5000,
        truth: Any = None,  # a name or a list of them, for which a schema has no other type
        data: str | None = None,
        first_frame: int = 0,
        start: str = "auto",
        seed: int = 0,
    ) -> None:
        if unit not in METRES:
            raise InputError(f"points: unit must be one of {', '.join(METRES)}, found {unit!r}")
        if not 0.0 < rate_hz < np.inf or most_points < 1 or first_frame < 0 or seed < 0:
            raise InputError(
                "points: expected a positive rate_hz, most_points of at least 1, first_frame and seed of at least 0, "
                f"found {rate_hz}, {most_points}, {first_frame}, {seed}"
            )
        self.source, self.rate_hz, self.unit = Path(source).expanduser(), rate_hz, unit
        self.most_points, self.first_frame, self.start, self.seed = most_points, first_frame, start, seed
        self._points = self._read()
        self._take: Take | None = None
        if truth is not None:
            self._take = find_take(
                truth, data=data, rate_hz=rate_hz, n_frames=len(self._points), first_frame=first_frame, seed=seed
            )
        check_start("points", start, self._take)

    @property
    def name(self) -> str:
        """The source's name."""
        return self.source.name

    @property
    def scale(self) -> float:
        """1: there are no images."""
        return 1.0

    @property
    def shape(self) -> Shape | None:
        """The measurements of the truth's person; None without truth."""
        return None if self._take is None else self._take.motion.shape

    @cached_property
    def start_pose(self) -> FloatArray | None:
        """With start="given" the first pose (P,), off by σ 3 cm and 0.05 rad in every number; else None."""
        return self._take.rough_start(self.seed) if self._take and self.start == "given" else None

    @property
    def phase_ends(self) -> tuple[float, float] | None:
        """With start="given" the phases of the first and the last frame, cycles (`splice.gait_phases`); else None."""
        return self._take.phase_ends if self._take and self.start == "given" else None

    @property
    def start_marks(self) -> None:
        """There are none."""
        return None

    def __len__(self) -> int:
        return len(self._points)

    def frames(self) -> Iterator[Frame]:
        """The frames in order, counted from 0, without views."""
        for i, points in enumerate(self._points):
            yield Frame(i, i / self.rate_hz, (), None if self._take is None else self._take.truths[i], points=points)

    def _read(self) -> list[FloatArray]:
        clouds, thinned = [], []
        for i, (name, points) in enumerate(self._files()):
            if len(points) > self.most_points:
                thinned.append(f"{name} with {len(points)}")
                rng = np.random.default_rng([self.seed, 1, i])
                points = points[np.sort(rng.choice(len(points), self.most_points, replace=False))]
            clouds.append(METRES[self.unit] * points)
        if thinned:
            warnings.warn(
                f"{self.source}: {len(thinned)} of {len(clouds)} frames have more than {self.most_points} points and "
                f"are thinned at random to so many, the first being {thinned[0]}",
                stacklevel=3,
            )
        return clouds

    def _files(self) -> Iterator[tuple[str, FloatArray]]:
        """The name and the points (K, 3), in the file's unit, of every frame."""
        if self.source.is_file() and self.source.suffix.lower() in (".h5", ".hdf5"):
            for i, points in enumerate(read_hdf5(self.source)):
                yield f"frame {i}", points
            return
        if not self.source.is_dir():
            raise InputError(f"{self.source}: expected a folder with files of points, or an .h5 or .hdf5 file")
        files = [file for file in self.source.iterdir() if file.suffix.lower() in READERS]
        kinds = sorted({file.suffix.lower() for file in files})
        if len(kinds) != 1:
            found = "files of several kinds, " + ", ".join(kinds) if kinds else "none"
            raise InputError(
                f"{self.source}: expected files of points of one kind ({', '.join(READERS)}), found {found}"
            )
        names = natural_order([file.name for file in files])
        for name in tqdm(names, desc=f"reading {self.source.name}", unit="frame", disable=None):
            yield name, READERS[kinds[0]](self.source / name)
