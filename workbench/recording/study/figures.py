"""A study's figures as numbers: exactly what was computed, beside what is drawn."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from workbench.arrays import FloatArray
from workbench.core.study import Bars, Curves, Figure, Scatter, Sticks
from workbench.errors import InputError


def numbers(figure: Figure) -> dict[str, Any]:
    """The figure as flat columns of strings, float64 and int64, none of them empty.

    kind: Curves, Bars, Scatter or Sticks. The others are the figure's fields; of {label: array} there are the columns
    <field>_labels, <field> (all arrays, one after the other) and <field>_sizes.
    """
    columns: dict[str, Any] = {"kind": type(figure).__name__, "name": figure.name}
    if isinstance(figure, Sticks):
        columns |= {"positions": figure.positions, "shape": figure.positions.shape, "parents": figure.parents}
        columns |= {"shades": figure.shades} | _flat("trails", figure.trails)
    elif isinstance(figure, Bars):
        columns |= {"x": figure.x, "heights": figure.heights, "x_name": figure.x_name}
        columns |= {} if figure.model is None else {"model": figure.model}
    elif isinstance(figure, Scatter):
        columns |= {"x_name": figure.x_name, "y_name": figure.y_name} | _flat("points", figure.points)
    else:
        columns |= {"x": figure.x, "x_name": figure.x_name, "y_name": figure.y_name}
        columns |= _flat("curves", figure.curves) | _flat("faint", figure.faint) | _flat("marks", figure.marks)
    return {key: np.ravel(value) for key, value in columns.items() if np.size(value)}


def figure_of(columns: Mapping[str, Sequence[Any]]) -> Figure:
    """The figure that `numbers` made these columns of; raises InputError for another kind."""
    kind, name = columns["kind"][0], columns["name"][0]
    if kind == "Sticks":
        trails = {label: values.reshape(-1, 3) for label, values in _mapping(columns, "trails").items()}
        positions = np.array(columns["positions"], dtype=np.float64).reshape(columns["shape"])
        return Sticks(name, positions, np.array(columns["parents"]), _floats(columns["shades"]), trails)
    if kind == "Bars":
        model = _floats(columns["model"]) if "model" in columns else None
        return Bars(name, _floats(columns["x"]), _floats(columns["heights"]), columns["x_name"][0], model)
    if kind == "Scatter":
        points = {label: values.reshape(-1, 2) for label, values in _mapping(columns, "points").items()}
        return Scatter(name, points, columns["x_name"][0], columns["y_name"][0])
    if kind == "Curves":
        marks = {label: float(value[0]) for label, value in _mapping(columns, "marks").items()}
        names = {"x_name": columns["x_name"][0], "y_name": columns["y_name"][0]}
        curves, faint = _mapping(columns, "curves"), _mapping(columns, "faint")
        return Curves(name, _floats(columns["x"]), curves, **names, marks=marks, faint=faint)
    raise InputError(f"recording: expected a figure of Curves, Bars, Scatter or Sticks, found {kind!r}")


def _flat(field: str, values: Mapping[str, FloatArray | float]) -> dict[str, Any]:
    arrays = [np.ravel(value).astype(np.float64) for value in values.values()]
    sizes = [len(array) for array in arrays]
    return {f"{field}_labels": list(values), field: np.concatenate([[], *arrays]), f"{field}_sizes": sizes}


def _mapping(columns: Mapping[str, Sequence[Any]], field: str) -> dict[str, FloatArray]:
    labels, sizes = columns.get(f"{field}_labels", []), columns.get(f"{field}_sizes", [])
    pieces = np.split(_floats(columns.get(field, [])), np.cumsum(sizes, dtype=np.int64)[:-1])
    return dict(zip(labels, pieces, strict=False))  # no label goes with the one empty piece of nothing


def _floats(values: Sequence[Any]) -> FloatArray:
    return np.array(values, dtype=np.float64)
