"""Writing of camera files in the TOML form of Pose2Sim and Sports2D, which `body.camera.load_cameras` reads."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2

from workbench.body.camera import Camera
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError


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
