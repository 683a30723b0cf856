"""3-D markers from TRC files or, with ezc3d (the extra `c3d`), C3D files, and the joints that they mark."""

import logging
import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.clip import WORLD_FROM_FILE
from workbench.motion.formats.text import fail, numbers, read_lines
from workbench.utils import input_limits
from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS, check_file, check_number, check_places, check_rate
from workbench.utils.sandbox import parse_limited

log = logging.getLogger(__name__)

MarkersOf = Mapping[str, Sequence[str]]
NO_MARKERS: MarkersOf = MappingProxyType({})
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_PERSON_M = 1.7  # a person's extent, which determines the unit: metres, centimetres or millimetres
_FIRST_ROW = 5  # of a TRC file, after three header lines and two of column labels


@dataclass(frozen=True, eq=False)
class Markers:
    """M markers in F frames at rate_hz. source : the file. positions : (F, M, 3), m, in the world, NaN where
    missing."""

    source: str
    names: tuple[str, ...]
    rate_hz: float
    positions: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Return positions (T, M, 3) at times (T,), s, since the first frame, interpolated linearly.

        NaN outside the frames, and where an adjacent frame lacks the marker.
        """
        rows = np.round(times_s * self.rate_hz, 6)
        low = np.floor(rows).astype(int)
        inside = (low >= 0) & (rows <= len(self.positions) - 1)
        before = self.positions[np.where(inside, low, 0)]
        after = self.positions[np.where(inside, np.ceil(rows).astype(int), 0)]
        fraction = (rows - low)[:, None, None]
        interpolated = np.where(fraction == 0.0, before, before + fraction * (after - before))
        return np.where(inside[:, None, None], interpolated, np.nan)


def read_markers(path: str | Path) -> Markers:
    """Return the markers of a .trc or .c3d file, with gaps; unit and axes as in `in_world`.

    Raises InputError if the file cannot be read; with the line, for a TRC file.
    """
    path, readers = Path(path).expanduser(), {".trc": _read_trc, ".c3d": _read_c3d}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: expected a marker file with the extension {' or '.join(readers)}")
    return readers[path.suffix.lower()](path)


def _read_trc(path: Path) -> Markers:
    lines = read_lines(path)
    if len(lines) <= _FIRST_ROW or not lines[0].startswith("PathFileType"):
        fail(path, 1, "expected a TRC file, whose first word is PathFileType")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    (rate_hz,) = numbers(path, 3, [header.get("DataRate", "").strip()], 1, "DataRate")
    check_rate(f"{path}, line 3: DataRate", rate_hz)
    names = [cell.strip() for cell in lines[3].split("\t")[2:] if cell.strip()]
    if not names or len(set(names)) < len(names):
        fail(path, 4, f"expected the names of markers, all different, found {', '.join(names)!r}")
    table = [(line, text) for line, text in enumerate(lines[_FIRST_ROW:], start=_FIRST_ROW + 1) if text.strip()]
    check_number(path, "markers", len(names), input_limits.MAX_JOINTS)
    check_number(path, "frames", len(table), input_limits.MAX_FRAMES)
    check_number(path, "coordinates", 3 * len(table) * len(names), MAX_NUMBERS)
    if not table:
        fail(path, len(lines), "expected a frame, found none")
    positions = np.array([_row(path, line, text, 3 * len(names)) for line, text in table])
    return in_world(str(path), names, rate_hz, positions.reshape(-1, len(names), 3), header.get("Units", "").strip())


def _row(path: Path, line: int, text: str, size: int) -> list[float]:
    """Return the coordinates (size,) of a frame, NaN for a blank or nan; trailing blanks may be missing."""
    cells = [cell.strip().lower() for cell in text.rstrip().split("\t")[2:]]
    if len(cells) > size:
        fail(path, line, f"expected {size} coordinates, found {len(cells)}")
    measured = [cell for cell in cells if cell not in ("", "nan")]
    values = iter(numbers(path, line, measured, len(measured), "coordinates"))
    cells += [""] * (size - len(cells))
    return [np.nan if cell in ("", "nan") else next(values) for cell in cells]


def _read_c3d(path: Path) -> Markers:
    try:
        import ezc3d  # noqa: F401 (for this message)
    except ImportError:
        raise InputError(f"{path}: reading C3D requires ezc3d: pip install -e '.[c3d]'") from None
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
    return in_world(str(path), names, rate_hz, positions, str(content["unit"]))


def _c3d_points(path: Path) -> dict[str, AnyArray]:
    """Return names (M,), rate_hz, positions (F, M, 3), NaN where missing, and unit of a C3D file's points.

    ezc3d, which reads it, loops or crashes on some damaged files.
    """
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


def in_world(source: str, names: Sequence[str], rate_hz: float, positions: FloatArray, unit: str) -> Markers:
    """Return markers at positions (F, M, 3), in a file's axes and unit, in metres with z up.

    The unit is estimated from the person's size, since headers are often wrong, and the vertical axis from the position
    of the upper body. Both are logged, with a warning if the header has another unit. Raises InputError if neither y
    nor z is up, or no marker is measured.
    """
    if not np.isfinite(positions).any():
        raise InputError(f"{source}: expected markers, found none in {len(positions)} frames")
    measured = positions[np.isfinite(positions[..., 0]).any(axis=1)]
    extent = np.median(np.linalg.norm(np.nanmax(measured, axis=1) - np.nanmin(measured, axis=1), axis=1))
    estimated = min(_UNITS, key=lambda name: abs(np.log(extent * _UNITS[name] / _PERSON_M)))
    up = _up(source, names, positions)
    log.info(
        "%s: %d markers, %d frames, read as %s with %s up", source, len(names), len(positions), estimated, "xyz"[up]
    )
    if unit.lower() not in (estimated, ""):
        log.warning("%s: the header's unit is %r, but the person would be %.3g %s tall", source, unit, extent, unit)
    world = positions if up == 2 else positions[..., WORLD_FROM_FILE]
    check_rate(source, rate_hz)
    check_places(source, world * _UNITS[estimated])
    return Markers(source, tuple(names), rate_hz, world * _UNITS[estimated])


def joints_of(markers: Markers, assigned: MarkersOf = NO_MARKERS) -> list[tuple[str, tuple[str, ...]]]:
    """Return the joints of the markers, each with the names of the markers at whose mean it is.

    assigned : markers by joint, where their names do not determine it or the joint's centre is between other markers.
    Raises InputError for unknown joints or markers, and if no joint is identified.
    """
    if unknown := sorted(set(assigned) - set(JOINT_NAMES)):
        raise InputError(f"{markers.source}: unknown joint {unknown[0]!r}, expected one of {', '.join(JOINT_NAMES)}")
    if unknown := sorted({name for names in assigned.values() for name in names} - set(markers.names)):
        raise InputError(f"{markers.source}: no marker {unknown[0]!r}, expected some of {', '.join(markers.names)}")
    plain = {_plain(name): name for name in reversed(markers.names)}
    joints = []
    for joint in JOINT_NAMES:
        matches = [names for names in _alternatives(joint) if all(name in plain for name in names)]
        if joint in assigned:
            joints.append((joint, tuple(assigned[joint])))
        elif matches:
            joints.append((joint, tuple(plain[name] for name in matches[0])))
    if not joints:
        raise InputError(f"{markers.source}: no marker has the name of a joint, found {', '.join(markers.names)}")
    return joints


def joint_centres(markers: Markers, positions: FloatArray, assigned: MarkersOf = NO_MARKERS) -> FloatArray:
    """Return the joint centres (F, J, 3), m, of markers at positions (F, M, 3); NaN where unknown; see `joints_of`."""
    centres = np.full((len(positions), len(JOINT_NAMES), 3), np.nan)
    for joint, names in joints_of(markers, assigned):
        centres[:, JOINT_NAMES.index(joint)] = positions[:, [markers.names.index(name) for name in names]].mean(axis=1)
    return centres


def _alternatives(joint: str) -> Iterable[tuple[str, ...]]:
    """Yield the names of a joint's markers, in lower-case letters, the best first."""
    yield (_plain(joint),)
    if joint == "pelvis":
        yield from (("midhip",), ("hip",), ("lhip", "rhip"), ("lefthip", "righthip"))
    elif joint == "head_centre":
        yield from (("neck", "head"), ("neck", "headtop"), ("lear", "rear"))  # "head" is the top of the head
    elif "_" in joint:
        side, part = joint.split("_")
        yield (side[0] + part,)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _up(source: str, names: Sequence[str], positions: FloatArray) -> int:
    """Return the vertical axis, along which shoulders, neck and head are above knees and ankles."""
    plain = [_plain(name) for name in names]
    high = [any(word in name for word in ("shoulder", "neck", "head", "sho", "c7")) for name in plain]
    low = [any(word in name for word in ("knee", "ankle", "heel", "toe", "ank", "kne")) for name in plain]
    if not (any(high) and any(low)):
        raise InputError(
            f"{source}: expected markers of shoulders or head and of knees or ankles, to determine the vertical axis"
        )
    above = np.nanmean(positions[:, high], axis=(0, 1)) - np.nanmean(positions[:, low], axis=(0, 1))
    up = int(np.argmax(np.abs(above)))
    if up == 0 or not above[up] > 0.0:
        raise InputError(f"{source}: expected y or z to be up, found {'-' if above[up] < 0.0 else ''}{'xyz'[up]}")
    return up
