"""A study's figures as numbers in full precision."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.util import find_spec
from typing import Any, get_args

import numpy as np

from workbench.core.study import Curves, Figure, Sticks
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

_KINDS: dict[str, type[Figure]] = {kind.__name__: kind for kind in get_args(Figure)}
_MAPPINGS = ("curves", "faint", "marks", "points")


def can_draw() -> bool:
    """Return whether matplotlib, the optional extra "plots", is installed."""
    return find_spec("matplotlib") is not None


def numbers(figure: Figure) -> dict[str, Any]:
    """Return the figure as flat columns of strings, float64 and int64, none of them empty.

    The column kind is Curves, Bars, Scatter or Sticks. The others are the figure's fields. A field {label: array} has
    the columns <field>_labels, <field> (the concatenated arrays) and <field>_sizes. Sticks also have the column shape,
    of their positions.
    """
    columns: dict[str, Any] = {"kind": type(figure).__name__}
    for field, value in vars(figure).items():
        if field in _MAPPINGS:
            arrays = [np.ravel(item).astype(np.float64) for item in value.values()]
            columns |= {f"{field}_labels": list(value), field: np.concatenate([[], *arrays])}
            columns[f"{field}_sizes"] = [len(array) for array in arrays]
        elif value is not None:
            columns[field] = value
    if isinstance(figure, Sticks):
        columns["shape"] = figure.positions.shape
    return {key: np.ravel(value) for key, value in columns.items() if np.size(value)}


def figure_of(columns: Mapping[str, Sequence[Any]]) -> Figure:
    """Return the figure from the columns of `numbers`; raises InputError for an unknown kind."""
    if (kind := _KINDS.get(columns["kind"][0])) is None:
        raise InputError(f"recording: expected a figure of {', '.join(_KINDS)}, found {columns['kind'][0]!r}")
    values: dict[str, Any] = {}
    for name in (field.name for field in fields(kind)):
        if name in _MAPPINGS:
            values[name] = _mapping(columns, name)
        elif name in columns:
            column, dtype = columns[name], np.int64 if name == "parents" else np.float64
            values[name] = column[0] if isinstance(column[0], str) else np.array(column, dtype=dtype)
    if kind is Sticks:
        values["positions"] = values["positions"].reshape(columns["shape"])
    if kind is Curves:
        values["marks"] = {label: float(value[0]) for label, value in values["marks"].items()}
    return kind(**values)


def _mapping(columns: Mapping[str, Sequence[Any]], field: str) -> dict[str, FloatArray]:
    labels, sizes = columns.get(f"{field}_labels", []), columns.get(f"{field}_sizes", [])
    pieces = np.split(np.array(columns.get(field, []), dtype=np.float64), np.cumsum(sizes, dtype=np.int64)[:-1])
    shaped = (piece.reshape(-1, 2) if field == "points" else piece for piece in pieces)
    return dict(zip(labels, shaped, strict=False))  # without labels there is one empty piece
