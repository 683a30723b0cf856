"""What a recording has of every frame as tables: columns of NumPy arrays, and data frames with pandas or polars.

Neither library is needed, or imported before it is used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np

from workbench.recording.read.chunks import Curve
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError

Columns: TypeAlias = dict[str, AnyArray]
"""A table: columns of one length, by name; the first is "frame"."""

EDGES = ("low", "mean", "high", "truth")
TABLES = ("poses", "joints", "true_joints", "bands", "metrics")
_BANDS = "posterior/parameters/"


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
    """Return the bands among recorded curves posterior/parameters/NAME/EDGE; K and F are 0 where there are none."""
    found = {entity.removeprefix(_BANDS): curve for entity, curve in scalars.items() if entity.startswith(_BANDS)}
    names = tuple(dict.fromkeys(each.rpartition("/")[0] for each in found))
    frames, values = aligned(found)
    missing = np.full(len(frames), np.nan)
    edges = {
        edge: np.array([values.get(f"{name}/{edge}", missing) for name in names]).reshape(len(names), len(frames)).T
        for edge in EDGES
    }
    return Bands(names, frames, **edges)


def aligned(curves: Mapping[str, Curve]) -> tuple[IntArray, dict[str, FloatArray]]:
    """Return the frames (F,) of any of the curves, ascending, and each curve's values (F,), NaN where it has none."""
    frames = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(curve.frames for curve in curves.values())]))
    values = {name: np.full(len(frames), np.nan) for name in curves}
    for name, curve in curves.items():
        values[name][np.searchsorted(frames, curve.frames)] = curve.values[:, 0]
    return frames, values


def long_table(frames: IntArray, kind: str, names: Sequence[str], values: Mapping[str, FloatArray]) -> Columns:
    """Return a table with a row for each name in each frame; kind: the names' column. values: (F, K) by column."""
    repeated = {"frame": np.repeat(frames, len(names)), kind: np.tile(np.array(names, dtype=np.str_), len(frames))}
    return repeated | {column: np.ravel(each) for column, each in values.items()}


def data_frame(library: str, columns: Mapping[str, Any]) -> Any:
    """Make a data frame of these columns with "pandas" or "polars"; raises InputError where it is not installed."""
    try:
        frames = import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        raise InputError(f"a {library} data frame needs the package {library}: pip install {library}") from None
    return frames.DataFrame(dict(columns))
