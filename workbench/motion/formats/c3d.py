"""Read C3D by ezc3d in the sandbox: it loops or crashes on some damaged files."""

import struct
from pathlib import Path

import numpy as np

from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MOST_NUMBERS, check_file, check_number
from workbench.utils.sandbox import parse_limited


def read_points(path: Path) -> tuple[list[str], float, FloatArray, str]:
    """Return labels (M), rate (Hz), positions (F, M, 3), NaN where missing, and unit of a C3D file's points.

    Raises InputError for other files, a header that announces more than the file has, and damage.
    """
    try:
        import ezc3d  # noqa: F401 (for this message)
    except ImportError:
        raise InputError(f"{path}: reading C3D needs ezc3d: pip install -e '.[c3d]'") from None
    check_file(path)
    _check_header(path)
    found = parse_limited(points, path, what="a C3D file")
    return found["names"].tolist(), float(found["rate_hz"]), found["positions"], str(found["unit"])


def _check_header(path: Path) -> None:
    """Raise InputError for no header, or one that announces more numbers than the file can hold."""
    with path.open("rb") as file:
        header = file.read(20)
    if len(header) < 20 or header[1] != 0x50:
        raise InputError(f"{path}: expected a C3D file, found no header of one")
    points, analog, first, last = struct.unpack("<HHHH", header[2:10])
    numbers = max(0, last - first + 1) * (4 * points + analog)
    check_number(path, "numbers", numbers, min(MOST_NUMBERS, path.stat().st_size // 2))


def points(path: Path) -> dict[str, AnyArray]:
    """Return what `read_points` does as arrays, by ezc3d."""
    import ezc3d

    content = ezc3d.c3d(str(path))
    point = content["parameters"]["POINT"]
    (rate_hz,) = point["RATE"]["value"]
    positions = np.asarray(content["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
    missing = (content["data"]["meta_points"]["residuals"][0].T < 0.0)[..., None]
    return {
        "names": np.array([str(name).strip() for name in point["LABELS"]["value"]], dtype=np.str_),
        "rate_hz": np.array(rate_hz, dtype=np.float64),
        "unit": np.array(str(next(iter(point["UNITS"]["value"]), "")).strip()),
        "positions": np.where(missing, np.nan, positions),
    }
