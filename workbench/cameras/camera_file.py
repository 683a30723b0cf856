"""Camera files: reading in the forms of several programs, and writing in the TOML form of Pose2Sim and Sports2D."""

import json
import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from workbench.cameras.camera import Camera
from workbench.cameras.camera_formats import SUFFIXES, camera_tables
from workbench.cameras.distortion import check_lens_error, five_coefficients
from workbench.cameras.laboratory_formats import HUMANEVA, laboratory_tables, refuse_pickle
from workbench.utils.arrays import FloatArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX, MAX_CONFIG, check_places, parse_toml
from workbench.utils.text import read_text

log = logging.getLogger(__name__)

_N_COEFFICIENTS = (1, 4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's lens models, and of Anipose's with the first one only."""
_MIN_FOCAL_PX = 1.0
"""Below, the smallest image, of 16 px, would span more than 165°."""
_ROUNDING = 0.01
"""Largest error of a rotation matrix, whose numbers may be rounded to three places."""


def load_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras of a file in TOML, OpenCV's YAML, XML and JSON, ROS' camera_info, or a laboratory's form, in the
    order of the file.

    Each camera has size [w, h], matrix, distortions (1, 4, 5, 8, 12 or 14 numbers), rotation (Rodrigues vector or
    matrix) and translation, in the file's unit; other tables and keys are ignored. In TOML (Pose2Sim, Sports2D,
    Anipose, FreeMoCap, Caliscope) it is a table with these keys, of which size and distortions may be absent; for the
    other forms see `camera_tables` and `laboratory_tables`. A camera whose file has no image size has the size 0, see
    `calibration.fitted`. Of cameras with and without a pose, those with one are returned. A folder of HumanEva's files
    is one calibration. Raises InputError if the file is missing, has another form, or a camera is incomplete.
    """
    tables = _tables(Path(path))
    missing = [key for key, table in tables.items() if not _has_pose(table)]
    if len(missing) == len(tables):
        raise InputError(
            f"{path}: camera [{missing[0]}] has no rotation and translation in the world, which the dataset video "
            "determines from a person's height; add them for other datasets, see workbench calibrate"
        )
    if missing:
        log.warning("%s: cameras without rotation and translation are ignored: %s", path, ", ".join(missing))
    return tuple(_camera(Path(path), key, table) for key, table in tables.items() if _has_pose(table))


def load_lenses(path: str | Path) -> tuple[Camera, ...]:
    """Return the cameras of a file without poses, at the world's origin; () if one has a pose.

    Raises InputError as `load_cameras` does.
    """
    tables = _tables(Path(path))
    if any(map(_has_pose, tables.values())):
        return ()
    pose = {"rotation": [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0]}
    return tuple(_camera(Path(path), key, {**table, **pose}) for key, table in tables.items())


def stated_unit(path: str | Path) -> str | None:
    """Return the unit of lengths that a camera file's format fixes, m, cm or mm; None where it does not.

    Raises InputError as `load_cameras` does.
    """
    return next((table["unit"] for table in _tables(Path(path)).values() if "unit" in table), None)


def _has_pose(table: Mapping[str, Any]) -> bool:
    return any(table.get(key, "null") != "null" for key in ("rotation", "translation"))  # "null": of Caliscope


def _tables(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the tables of the cameras in a file by name, at least one."""
    if not path.exists():
        raise InputError(f"{path}: no such camera file")
    refuse_pickle(path)
    if path.is_dir() and (files := sorted(path.glob(f"*{HUMANEVA}"))):
        return {name: table for file in files for name, table in _tables(file).items()}
    text = read_text(path, MAX_CONFIG)
    if (laboratory := laboratory_tables(path, text)) is not None:
        return dict(laboratory)
    if path.suffix.lower() in SUFFIXES:
        return dict(camera_tables(path, text))
    tables = parse_toml(path, text)
    if isinstance(inner := tables.get("cameras"), dict):
        tables = inner
    tables = {key: table for key, table in tables.items() if key != "metadata" and isinstance(table, dict)}
    cameras = {key: table for key, table in tables.items() if not {"matrix", "distortions"}.isdisjoint(table)}
    if not cameras:
        raise InputError(f"{path}: expected at least one camera table with a 'matrix', found none")
    if plain := [key for key, table in cameras.items() if "distortions" not in table]:
        log.warning("%s: cameras without distortions: %s; none are assumed", path, ", ".join(plain))
    return {key: {"size": None, "distortions": [0.0] * 5, **table} for key, table in cameras.items()}


def _camera(path: Path, key: str, table: Mapping[str, Any]) -> Camera:
    def numbers(name: str, *shapes: tuple[int, ...]) -> FloatArray:
        expected = " or ".join("×".join(map(str, shape)) for shape in shapes)
        try:
            values = np.array(table[name], dtype=np.float64)
            values = values.ravel() if values.ndim == 2 and 1 in values.shape else values
            values = values.reshape(3, 3) if values.shape == (9,) else values
        except KeyError:
            raise InputError(f"{path}: camera [{key}] has no {name!r}; expected {expected} numbers") from None
        except (TypeError, ValueError, OverflowError):
            values = np.empty(0)
        if values.shape not in shapes or not np.isfinite(values).all():
            raise InputError(f"{path}: camera [{key}]: {name!r} must hold {expected} numbers, found {table[name]!r}")
        return values

    is_sized = table.get("size", ()) is not None
    width, height = numbers("size", (2,)) if is_sized else (0.0, 0.0)
    if is_sized and not (1.0 <= width <= LARGEST_PX and 1.0 <= height <= LARGEST_PX):
        raise InputError(f"{path}: camera [{key}]: expected a size of 1 to {LARGEST_PX:g} px, found {table['size']}")
    matrix = numbers("matrix", (3, 3))
    if not np.abs(matrix).max() <= LARGEST_PX:
        raise InputError(f"{path}: camera [{key}]: expected a matrix up to {LARGEST_PX:g} px, found {table['matrix']}")
    if not (matrix.diagonal()[:2] >= _MIN_FOCAL_PX).all():
        raise InputError(
            f"{path}: camera [{key}]: expected focal lengths of {_MIN_FOCAL_PX:g} px or more in the matrix"
        )
    translation = numbers("translation", (3,))
    check_places(f"{path}: camera [{key}]", translation)
    turn = numbers("rotation", (3,), (3, 3))
    rotation = cv2.Rodrigues(turn)[0].astype(np.float64) if turn.ndim == 1 else turn
    if not (np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROUNDING and np.linalg.det(rotation) > 0.0):
        raise InputError(f"{path}: camera [{key}]: expected a rotation, found {table['rotation']!r}")
    coefficients, fisheye = numbers("distortions", *((n,) for n in _N_COEFFICIENTS)), bool(table.get("fisheye"))
    distortion = np.zeros(5)
    distortion[: min(5, coefficients.size)] = coefficients[:5]
    if fisheye or coefficients[5:].any():
        # OpenCV's stereo sample writes no size; the principal point is near the middle
        extent = (int(width), int(height)) if is_sized else tuple(np.rint(2.0 * matrix[:2, 2]).astype(int).tolist())
        distortion, matrix, error_px = five_coefficients(extent, matrix, coefficients, fisheye)
        check_lens_error(f"{path}: camera [{key}]", error_px)
    return Camera(
        name=str(table.get("name", key)), width=int(width), height=int(height), matrix=matrix,
        rotation=rotation, translation=translation, distortion=distortion,
    )  # fmt: skip


def check_name(name: str) -> str:
    """Return a camera's name; raises InputError for a name that is empty, reserved or no bare TOML key."""
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name) or name == "metadata":
        raise InputError(f"{name!r}: expected a camera's name of letters, digits, _ and -, other than metadata")
    return name


def write_cameras(path: Path, cameras: Sequence[Camera], error_px: float, notes: Mapping[str, str]) -> None:
    """Write cameras to a TOML file.

    Parameters
    ----------
    error_px : mean reprojection error
    notes : remarks by key, which readers ignore

    Raises
    ------
    InputError
        For a camera's name that is not allowed, and a file that cannot be written.
    """
    tables: dict[str, Mapping[str, object]] = {
        check_name(camera.name): {
            "name": camera.name, "size": [camera.width, camera.height], "matrix": camera.matrix.tolist(),
            "distortions": camera.distortion.tolist(), "rotation": cv2.Rodrigues(camera.rotation)[0].ravel().tolist(),
            "translation": camera.translation.tolist(), "fisheye": False,
        } for camera in cameras
    }  # fmt: skip
    tables["metadata"] = {"adjusted": False, "error": round(error_px, 4), **notes}
    # numbers, strings, lists and booleans of TOML are written as those of JSON
    texts = [
        f"[{name}]\n" + "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in table.items())
        for name, table in tables.items()
    ]
    with whole_file(path) as part:
        part.write_text("\n".join(texts), encoding="utf-8")
