"""Markers of C3D files, read and written with ezc3d (the extra `c3d`)."""

import logging
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workbench.motion.formats.text import report_count
from workbench.motion.formats.trc import RawMarkers
from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS, check_file, check_number, check_rate
from workbench.utils.sandbox import parse_limited

log = logging.getLogger(__name__)

_MAX_FRAMES = 65_535
"""Of a file; the header counts them in 16 bits."""
_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")  # lists of labels that are no positions


def check_c3d_installed(path: Path) -> None:
    """Raise InputError, with the file and the remedy, if ezc3d is not installed."""
    try:
        import ezc3d  # noqa: F401 (for this message)
    except ImportError:
        raise InputError(f"{path}: C3D requires ezc3d: pip install -e '.[c3d]'") from None


def write_c3d(
    path: Path, names: Sequence[str], positions: FloatArray, rate_hz: float, unit: str, per_metre: float
) -> None:
    """Write a C3D file of points, z up and x ahead.

    Parameters
    ----------
    names, positions : of M points, positions (F, M, 3), m, NaN for missing ones, which get the residual −1.
    unit, per_metre : name of the file's unit of length and its number in a metre.

    Raises
    ------
    InputError
        For more frames than the format counts, and if ezc3d is not installed.
    """
    check_c3d_installed(path)
    import ezc3d

    check_number(path, "frames", len(positions), _MAX_FRAMES)
    content, values = ezc3d.c3d(), positions.transpose(2, 1, 0) * per_metre
    point, shape = content["parameters"]["POINT"], values.shape[1:]
    for key, value in {"LABELS": list(names), "UNITS": [unit], "RATE": [rate_hz]}.items():
        point[key]["value"] = value
    for key, value in {"X_SCREEN": "+X", "Y_SCREEN": "+Z"}.items():
        content.add_parameter("POINT", key, [value])
    content["data"]["points"] = np.concatenate([values, np.ones((1, *shape))])
    content["data"]["meta_points"]["residuals"] = np.where(np.isnan(values).any(axis=0), -1.0, 0.0)[None]
    content["data"]["meta_points"]["camera_masks"] = np.zeros((7, *shape), dtype=bool)
    content.write(str(path))


def read_c3d(path: Path) -> RawMarkers:
    """Return the markers of a C3D file without a model's outputs; raises InputError if it cannot be read."""
    check_c3d_installed(path)
    check_file(path)
    with path.open("rb") as file:
        header = file.read(20)
    if len(header) < 20 or header[1] != 0x50:
        raise InputError(f"{path}: expected a C3D file, found no C3D header")
    points, analog, first, last = struct.unpack("<HHHH", header[2:10])
    n_numbers = max(0, last - first + 1) * (4 * points + analog)
    check_number(path, "numbers", n_numbers, min(MAX_NUMBERS, path.stat().st_size // 2))
    content = parse_limited(_c3d_points, path, what="a C3D file")
    names, rate_hz, positions = content["names"].tolist(), float(content["rate_hz"]), content["positions"]
    if not names or not rate_hz > 0.0 or positions.shape[1:] != (len(names), 3):
        raise InputError(
            f"{path}: expected labelled points and a positive rate, found {len(names)} labels at {rate_hz:g} Hz"
        )
    if last < _MAX_FRAMES:  # longer files have their number of frames elsewhere
        report_count(path, last - first + 1, len(positions))
    if first > 1:
        log.warning("%s: starts at frame %d, which is used as the first frame", path, first)
    outputs = set(content["outputs"].tolist())
    chosen = [k for k, name in enumerate(names) if name not in outputs]
    up = {f"{sign}{axis}": f"{sign}{axis}".lower().removeprefix("+") for sign in ("+", "-", "") for axis in "XYZ"}
    vertical = up.get(str(content["y_screen"]).upper())
    check_rate(str(path), rate_hz)
    return RawMarkers([names[k] for k in chosen], rate_hz, positions[:, chosen], str(content["unit"]), vertical)


def _c3d_points(path: Path) -> dict[str, AnyArray]:
    """Return names (M,), rate_hz, positions (F, M, 3), NaN where missing, unit, the labels of a model's outputs and the
    axis that is up on the screen, of a C3D file's points.

    ezc3d, which reads it, loops or crashes on some damaged files.
    """
    import ezc3d

    content = ezc3d.c3d(str(path))
    point = content["parameters"]["POINT"]

    def texts(key: str) -> list[str]:
        """Return the texts of a parameter, with its continuations <key>2, <key>3, …"""
        values: list[str] = []
        for name in (key, *[f"{key}{n}" for n in range(2, 100)]):
            if name not in point:
                break
            values += [str(value).strip() for value in point[name]["value"]]
        return values

    rate_hz = next(iter(np.ravel(point["RATE"]["value"])), 0.0) or content["header"]["points"]["frame_rate"]
    positions = np.asarray(content["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
    missing = (content["data"]["meta_points"]["residuals"][0].T < 0.0)[..., None]
    names = texts("LABELS")[: positions.shape[1]]
    names += [f"*{k}" for k in range(len(names), positions.shape[1])]  # unlabelled points
    return {
        "names": np.array(names, dtype=np.str_),
        "rate_hz": np.array(rate_hz, dtype=np.float64),
        "unit": np.array(next(iter(texts("UNITS")), ""), dtype=np.str_),
        "outputs": np.array([label for key in _OUTPUTS for label in texts(key)], dtype=np.str_),
        "y_screen": np.array(next(iter(texts("Y_SCREEN")), ""), dtype=np.str_),
        "positions": np.where(missing, np.nan, positions),
    }
