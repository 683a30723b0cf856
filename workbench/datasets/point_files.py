"""Dataset of points from files: one file per frame, or one file of all frames."""

import logging
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.units import UNITS, unit_of_extent
from workbench.core.capabilities import POINTS, START, Traits, component_traits
from workbench.core.checks import RATE, at_least, check, one_of, optional
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.datasets.point_formats import READERS, read_hdf5
from workbench.datasets.rendering import sequence
from workbench.datasets.rendering.sequence import RenderedSequence, Scene, find_sequence
from workbench.motion.formats.units_axes import AXES, world_axes
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_places
from workbench.utils.input_path import InputPath, expanded
from workbench.utils.rng import stream
from workbench.utils.text import natural_order

log = logging.getLogger(__name__)

_UNITS = ("m", "cm", "mm", "inch")
_EXTENTS = {"m": (0.0, 20.0), "cm": (20.0, 500.0), "mm": (500.0, np.inf)}
"""Extents of a cloud by its unit: up to a room of 20 m, or a person in 5 m of surroundings."""
_SAME_RATE = 0.01
_ON_GRID = 0.3  # of a step: larger deviations are no equal intervals


@dataclass(eq=False)
class PointFiles:
    """Frames of points in the world (z up); all files are read at the first access to `info`.

    A frame may be without points. Raises InputError for parameters out of range. `info` does, with file and line, row
    or vertex, for unreadable files, numbers out of range, a motion that does not exist, and missing frames.

    Parameters
    ----------
    source : a folder of files, one per frame, all of one format of `point_formats.READERS`, in the order of their
        numbers or times (frame_9 before frame_10, 12.0625 before 12.5), where missing ones are frames without points;
        or one .h5 or .hdf5 file, see `point_formats.read_hdf5`.
    unit : m, cm, mm or inch; None: by the size of the clouds: m, unless that is over 20 m.
    up : vertical axis of the files, x, y, z, -x, -y or -z.
    max_points : frames with more are subsampled at random, with a warning.
    truth : name of a motion (`sources.find_motion`; data: its folder) at rate_hz. It gives every frame its true pose,
        joints and activity, and the person's measurements. Without it none of these are known.
    first_frame : number of the first frame used, counted from 0.
    n_frames : number of frames used; None: to the end.
    truth_first_frame : frame of the files that corresponds to the truth's first.
    initialization : as for `points.Points`; "perturbed_truth" needs the truth.
    seed : of the initialization and of the subsampling.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which allow initialization, and the assumptions on the initial pose."""
        return component_traits(POINTS, START, *sequence.provided_assumptions(keys))

    source: InputPath
    rate_hz: float = 14.0
    unit: str | None = None
    up: str = "z"
    max_points: int = 5000
    truth: Any = None  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    first_frame: int = 0
    n_frames: int | None = None
    truth_first_frame: int = 0
    initialization: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        check("points", self, up=one_of(*AXES), rate_hz=RATE, max_points=at_least(1))
        check("points", self, first_frame=at_least(0), seed=at_least(0), n_frames=optional(at_least(1)))
        check("points", self, unit=optional(one_of(*_UNITS)))
        if self.truth is not None and self.first_frame < self.truth_first_frame:
            frames = f"first_frame={self.first_frame} and truth_first_frame={self.truth_first_frame}"
            raise InputError(f"points: expected first_frame of at least truth_first_frame, found {frames}")

    @cached_property
    def info(self) -> SequenceInfo:
        """The number of frames, the true person's measurements, and the initial pose and phases."""
        initial_pose, phase_ends = sequence.perturbed_initialization(
            "points", self.initialization, self._sequence, self.seed
        )
        return SequenceInfo(
            name=self._path.name, n_frames=len(self._points), rate_hz=self.rate_hz,
            shape=self._sequence.motion.shape if self._sequence else None, initial_pose=initial_pose, has_points=True,
            phase_ends=phase_ends,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, with their numbers in the source, without views."""
        for i, points in enumerate(self._points):
            index, truth = self.first_frame + i, None if self._sequence is None else self._sequence.truths[i]
            yield Frame(index, index / self.rate_hz, (), truth, points=points)

    @cached_property
    def _path(self) -> Path:
        return expanded(self.source)

    @cached_property
    def _sequence(self) -> RenderedSequence | None:
        if self.truth is None:
            return None
        first = self.first_frame - self.truth_first_frame
        frames: dict[str, Any] = {"n_frames": len(self._points), "first_frame": first, "perturb": False}
        return find_sequence(Scene(motion=self.truth, data=self.data, rate_hz=self.rate_hz, seed=self.seed, **frames))

    @cached_property
    def _points(self) -> list[FloatArray]:
        """Points (K, 3) of every frame used, m."""
        clouds, subsampled, n = [], [], 0
        end = None if self.n_frames is None else self.first_frame + self.n_frames
        for i, (name, points) in enumerate(islice(self._files(), end)):
            n = i + 1
            if i < self.first_frame:
                continue
            if len(points) > self.max_points:
                subsampled.append(f"{name} with {len(points)}")
                rng = stream(self.seed, "thinning", i)
                points = points[np.sort(rng.choice(len(points), self.max_points, replace=False))]
            clouds.append(points)
        if n < (self.first_frame + 1 if end is None else end):
            raise InputError(f"{self.source}: no frame {max(n, self.first_frame)}, expected one of 0 to {n - 1}")
        if subsampled:
            frames = f"{len(subsampled)} of {len(clouds)} frames have more than max_points={self.max_points} points"
            message = f"{self.source}: {frames} and are subsampled at random, the first being {subsampled[0]}"
            warnings.warn(message, stacklevel=3)
        if empty := [str(self.first_frame + k) for k, points in enumerate(clouds) if not len(points)]:
            log.warning(
                "%s: %d of %d frames have no points: %s", self.source, len(empty), len(clouds), ", ".join(empty[:9])
            )
        if len(empty) == len(clouds):
            raise InputError(f"{self.source}: expected points, found none in {len(clouds)} frames")
        metres, axes = self._metres_per_unit(clouds), world_axes(self.up)
        world = [metres * points if self.up == "z" else axes.vectors(metres * points) for points in clouds]
        for k, points in enumerate(world):
            check_places(f"{self.source}: frame {self.first_frame + k}", points)
        return world

    def _metres_per_unit(self, clouds: list[FloatArray]) -> float:
        """Return the metres per unit of the clouds: metres, unless they are larger than any room with a person."""
        if self.unit is not None:
            return UNITS[self.unit]
        extent = float(np.median([np.ptp(points, axis=0).max() for points in clouds if len(points)]))
        unit = unit_of_extent(extent, _EXTENTS) or "mm"
        if unit != "m":
            log.warning("%s: the clouds extend over %.3g; read in %s (key unit)", self.source, extent, unit)
        return UNITS[unit]

    def _files(self) -> Iterator[tuple[str, FloatArray]]:
        """Yield the name and the points (K, 3), in the file's unit, of every frame."""
        if self._path.is_file() and self._path.suffix.lower() in (".h5", ".hdf5"):
            for i, points in enumerate(read_hdf5(self._path)):
                yield f"frame {i}", points
            return
        if not self._path.is_dir():
            raise InputError(f"{self._path}: expected a folder with files of points, or an .h5 or .hdf5 file")
        files = [file for file in self._path.iterdir() if file.suffix.lower() in READERS and file.name[0] != "."]
        kinds = sorted({file.suffix.lower() for file in files})
        if len(kinds) != 1:
            present, formats = "several formats, " + ", ".join(kinds) if kinds else "none", ", ".join(READERS)
            raise InputError(f"{self._path}: expected files of points in one format of {formats}, found {present}")
        names = self._with_gaps(natural_order([file.name for file in files]))
        for name in tqdm(names, desc=f"reading {self._path.name}", unit="frame", disable=None):
            yield name or "a missing file", READERS[kinds[0]](self._path / name) if name else np.empty((0, 3))

    def _with_gaps(self, numbered: list[tuple[str, float | None]]) -> list[str]:
        """Return the files' names in order, "" for a missing one where their numbers are at equal intervals."""
        names, numbers = [name for name, _ in numbered], np.array([number for _, number in numbered], dtype=float)
        steps = np.diff(numbers)
        if not len(steps) or not (steps > 0.0).all():
            return names
        step = float(np.median(steps))
        places = (numbers - numbers[0]) / step
        if any("." in Path(name).stem for name in names) and abs(1.0 / step / self.rate_hz - 1.0) > _SAME_RATE:
            message = "%s: the files' numbers increase by %.4g; if these are seconds, set rate_hz to %.4g, found %g"
            log.warning(message, self.source, step, 1.0 / step, self.rate_hz)
        n = round(places[-1]) + 1
        if n == len(names) or n > 2 * len(names) or (np.abs(places - np.round(places)) > _ON_GRID).any():
            return names
        log.warning("%s: %d of %d files are missing by their numbers", self.source, n - len(names), n)
        files = dict(zip(np.round(places).astype(int).tolist(), names, strict=True))
        return [files.get(k, "") for k in range(n)]
