"""Camera files of the Pose2Sim and Sports2D form, written; `body.camera.load_cameras` reads them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.errors import InputError
from workbench.files import whole_file

NAME_LETTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-")
"""Of which a TOML table's name is made without quotation marks."""


def check_name(name: str) -> str:
    """Return a camera's name; raises InputError for one that is empty, reserved or of other letters."""
    if not name or not set(name) <= NAME_LETTERS or name == "metadata":
        raise InputError(f"{name!r}: expected a camera's name of letters, digits, _ and -, other than metadata")
    return name


def write_cameras(path: Path, cameras: Sequence[Camera], error_px: float, notes: Mapping[str, str]) -> None:
    """Write cameras to a TOML file, with the mean error, px, and remarks by name, which readers pass over.

    Raises InputError where it cannot be written.
    """
    tables = [_table(camera) for camera in cameras]
    remarks = "".join(f"{key} = {_text(value)}\n" for key, value in notes.items())
    tables.append(f"[metadata]\nadjusted = false\nerror = {error_px:.4f}\n{remarks}")
    with whole_file(path) as part:
        part.write_text("\n".join(tables), encoding="utf-8")


def _table(camera: Camera) -> str:
    rotation = np.asarray(cv2.Rodrigues(camera.rotation)[0], np.float64).ravel()
    matrix = ", ".join(_numbers(row) for row in camera.matrix)
    return (
        f'[{check_name(camera.name)}]\nname = "{camera.name}"\nsize = [{camera.width}, {camera.height}]\n'
        f"matrix = [{matrix}]\ndistortions = {_numbers(camera.distortion)}\n"
        f"rotation = {_numbers(rotation)}\ntranslation = {_numbers(camera.translation)}\nfisheye = false\n"
    )


def _numbers(values: FloatArray) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _text(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
