"""Tables of a recording's frames: columns of NumPy arrays, and data frames of pandas or polars, imported on use."""

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
TABLES = ("poses", "joints", "true_joints", "intervals", "metrics")
_PARAMETERS = "posterior/parameters/"


@dataclass(frozen=True, eq=False)
class CredibleIntervals:
    """The posterior of K parameters over frames.

    names: K parameters of the pose and of the prior's state. frames: (F,). low, mean, high, truth: (F, K), in the
    parameters' units (m, rad); low to high is the 90 % credible interval. NaN where a value was not recorded.
    """

    names: tuple[str, ...]
    frames: IntArray
    low: FloatArray
    mean: FloatArray
    high: FloatArray
    truth: FloatArray


def intervals_of(scalars: Mapping[str, Curve]) -> CredibleIntervals:
    """Return the credible intervals in recorded curves posterior/parameters/NAME/EDGE; K and F may be 0."""
    edge_curves = {
        entity.removeprefix(_PARAMETERS): curve for entity, curve in scalars.items() if entity.startswith(_PARAMETERS)
    }
    names = tuple(dict.fromkeys(each.rpartition("/")[0] for each in edge_curves))
    frames, values = aligned(edge_curves)
    missing = np.full(len(frames), np.nan)
    edges = {
        edge: np.array([values.get(f"{name}/{edge}", missing) for name in names]).reshape(len(names), len(frames)).T
        for edge in EDGES
    }
    return CredibleIntervals(names, frames, **edges)


def aligned(curves: Mapping[str, Curve]) -> tuple[IntArray, dict[str, FloatArray]]:
    """Return the frames (F,) of any of the curves, ascending, and each curve's values (F,), NaN where it has none."""
    frames = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(curve.frames for curve in curves.values())]))
    values = {name: np.full(len(frames), np.nan) for name in curves}
    for name, curve in curves.items():
        values[name][np.searchsorted(frames, curve.frames)] = curve.values[:, 0]
    return frames, values


def long_table(frames: IntArray, kind: str, names: Sequence[str], values: Mapping[str, FloatArray]) -> Columns:
    """Return a table with a row for each name in each frame.

    Parameters
    ----------
    frames : (F,).
    kind : name of the column of the names.
    names : K.
    values : (F, K) by column.
    """
    repeated = {"frame": np.repeat(frames, len(names)), kind: np.tile(np.array(names, dtype=np.str_), len(frames))}
    return repeated | {column: np.ravel(each) for column, each in values.items()}


def data_frame(library: str, columns: Mapping[str, Any]) -> Any:
    """Return the columns as a data frame of "pandas" or "polars"; raises InputError where it is not installed."""
    try:
        frames = import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        raise InputError(f"a {library} data frame needs the package {library}: pip install {library}") from None
    return frames.DataFrame(dict(columns))
