"""The reader of C3D files, by ezc3d (the extra `c3d`)."""

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.mocap.markers import Markers, in_world


def read_c3d(path: Path) -> Markers:
    """The markers of a C3D file; unit and axes: see `in_world`. Raises InputError for what ezc3d cannot read."""
    try:
        import ezc3d
    except ImportError:
        raise InputError(f"{path}: reading C3D needs ezc3d: pip install -e '.[c3d]'") from None
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        content = ezc3d.c3d(str(path))
    except OSError as error:  # what it raises for any file that it cannot read
        raise InputError(f"{path}: expected a C3D file: {error}") from None
    point = content["parameters"]["POINT"]
    names = [str(name).strip() for name in point["LABELS"]["value"]]
    (rate_hz,) = point["RATE"]["value"]
    positions = np.asarray(content["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
    if not names or not rate_hz > 0.0 or positions.shape[1] != len(names):
        raise InputError(f"{path}: expected labelled points at a rate, found {len(names)} labels at {rate_hz:g} Hz")
    missing = (content["data"]["meta_points"]["residuals"][0].T < 0.0)[..., None]
    unit = next(iter(point["UNITS"]["value"]), "")
    return in_world(str(path), names, float(rate_hz), np.where(missing, np.nan, positions), str(unit).strip())
