"""What a recording has of every frame as tables: columns of NumPy arrays, and data frames with pandas or polars.

Neither library is needed, or imported before it is asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol, TypeAlias

import numpy as np

from workbench.recording.read.chunks import Curve
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError

Columns: TypeAlias = dict[str, AnyArray]
"""A table: columns of one length, by name; the first is "frame"."""

EDGES = ("low", "mean", "high", "truth")
TABLES = ("poses", "joints", "true_joints", "bands", "metrics")


class Places(Protocol):
    """Named points over frames. names: J. frames: (F,). positions: (F, J, 3)."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def frames(self) -> IntArray: ...
    @property
    def positions(self) -> FloatArray: ...


@dataclass(frozen=True, eq=False)
class Bands:
    """The posterior of K parameters over frames. names: K, numbers of the pose and of the prior's state. frames: (F,).

    low, mean, high, truth: (F, K), in the parameters' units (m, rad); low to high is the 5–95 % band. NaN where one was
    not recorded, as the truth where there is none.
    """

    names: tuple[str, ...]
    frames: IntArray
    low: FloatArray
    mean: FloatArray
    high: FloatArray
    truth: FloatArray


def bands_of(scalars: Mapping[str, Curve]) -> Bands:
    """Collect the bands among recorded curves posterior/parameters/NAME/EDGE; K and F are 0 where there are none."""
    found: dict[str, dict[str, Curve]] = {}
    for entity, curve in scalars.items():
        if entity.startswith("posterior/parameters/"):
            name, _, edge = entity.removeprefix("posterior/parameters/").rpartition("/")
            found.setdefault(name, {})[edge] = curve
    frames = _frames([curve for edges in found.values() for curve in edges.values()])
    values = {edge: np.full((len(frames), len(found)), np.nan) for edge in EDGES}
    for k, edges in enumerate(found.values()):
        for edge in EDGES:
            if edge in edges:
                values[edge][np.searchsorted(frames, edges[edge].frames), k] = edges[edge].values[:, 0]
    return Bands(tuple(found), frames, **values)


def table_of_poses(names: tuple[str, ...], frames: IntArray, poses: FloatArray) -> Columns:
    """A row for each frame: the pose's numbers (F, P) by name, m and rad."""
    return {"frame": frames, **dict(zip(names, poses.T, strict=True))}


def table_of_joints(joints: Places) -> Columns:
    """A row for each joint of each frame: frame, joint, x, y, z, m, in the world."""
    x, y, z = joints.positions.reshape(-1, 3).T
    frames, names = _long(joints.frames, joints.names)
    return {"frame": frames, "joint": names, "x": x, "y": y, "z": z}


def table_of_bands(bands: Bands) -> Columns:
    """A row for each parameter of each frame: frame, parameter, low, mean, high, truth."""
    frames, names = _long(bands.frames, bands.names)
    return {"frame": frames, "parameter": names, **{edge: getattr(bands, edge).ravel() for edge in EDGES}}


def table_of_metrics(metrics: Mapping[str, Curve]) -> Columns:
    """A row for each frame, a column for each metric; NaN in frames in which it was not measured."""
    frames = _frames(list(metrics.values()))
    columns: Columns = {"frame": frames}
    for name, curve in sorted(metrics.items()):
        columns[name] = np.full(len(frames), np.nan)
        columns[name][np.searchsorted(frames, curve.frames)] = curve.values[:, 0]
    return columns


def data_frame(library: str, columns: Mapping[str, Any]) -> Any:
    """Make a data frame of these columns with "pandas" or "polars"; raises InputError where it is not installed."""
    try:
        frames = import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        raise InputError(f"a {library} data frame needs the package {library}: pip install {library}") from None
    return frames.DataFrame(dict(columns))


def _frames(found: list[Curve]) -> IntArray:
    """Unite the frames of curves, ascending."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(curve.frames for curve in found)]))


def _long(frames: IntArray, names: tuple[str, ...]) -> tuple[IntArray, AnyArray]:
    """Frame and name of every row of a table that has one for each name in each frame."""
    return np.repeat(frames, len(names)), np.tile(np.array(names, dtype=np.str_), len(frames))
