"""Reading C3D by ezc3d in a process of its own: on some damaged files it runs for ever or ends whoever calls it."""

import io
import struct
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workbench.apart import bounded, read_apart
from workbench.arrays import FloatArray
from workbench.errors import InputError
from workbench.limits import MOST_NUMBERS, check_file, check_number


def read_points(path: Path) -> tuple[list[str], float, FloatArray, str]:
    """Read the labels, the rate, Hz, the positions (F, M, 3), NaN where missing, and the unit of a C3D file's points.

    Raises InputError for what is none, for a header that says more than the file has, and where ezc3d does not come
    back in time.
    """
    try:
        import ezc3d  # noqa: F401 (to say so here)
    except ImportError:
        raise InputError(f"{path}: reading C3D needs ezc3d: pip install -e '.[c3d]'") from None
    check_file(path)
    _check_header(path)
    content = read_apart(__name__, path, "a C3D file")
    with np.load(io.BytesIO(content), allow_pickle=False) as found:
        names = [str(name) for name in found["names"]]
        return names, float(found["rate_hz"]), found["positions"], str(found["unit"])


def _check_header(path: Path) -> None:
    """Refuse a header that is none, or that announces more numbers than the file can hold."""
    with path.open("rb") as file:
        header = file.read(20)
    if len(header) < 20 or header[1] != 0x50:
        raise InputError(f"{path}: expected a C3D file, found no header of one")
    points, analog, first, last = struct.unpack("<HHHH", header[2:10])
    numbers = max(0, last - first + 1) * (4 * points + analog)
    check_number(path, "numbers", numbers, min(MOST_NUMBERS, path.stat().st_size // 2))


def _points(path: Path) -> bytes:
    """Read the points, in the other process, as NPZ."""
    import ezc3d

    content = ezc3d.c3d(str(path))
    point = content["parameters"]["POINT"]
    names: Sequence[str] = [str(name).strip() for name in point["LABELS"]["value"]]
    (rate_hz,) = point["RATE"]["value"]
    positions = np.asarray(content["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
    missing = (content["data"]["meta_points"]["residuals"][0].T < 0.0)[..., None]
    unit = str(next(iter(point["UNITS"]["value"]), "")).strip()
    out = io.BytesIO()
    np.savez(
        out, names=np.array(names, dtype=np.str_), rate_hz=np.float64(rate_hz), unit=np.str_(unit),
        positions=np.where(missing, np.nan, positions),
    )  # fmt: skip
    return out.getvalue()


if __name__ == "__main__":
    bounded(sys.argv[1], _points)
