"""Motions out: a track of joints as a file that Blender (BVH), OpenSim (TRC) or a spreadsheet (CSV) opens."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.motion.clip import FILE_FROM_WORLD
from workbench.motion.formats.bvh import PER_METRE, bvh_text
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

SUFFIXES = (".bvh", ".trc", ".csv")
_TRC_DIGITS = {"mm": 4, "m": 7}  # a tenth of a micrometre
_N_POSITIONS = 3


@dataclass(frozen=True, eq=False)
class Track:
    """F frames of the J joints of a skeleton, in the world.

    frames: (F,), their numbers in the source. times_s: (F,), rising. positions: (F, J, 3), m. poses: (F, P), m and
    rad, that the positions are those of; None where the joints are known but not the pose. bands: (F,) by name, the
    ends of 5–95 % bands of single numbers, in their own units; of the table alone.
    """

    skeleton: Skeleton
    frames: IntArray
    times_s: FloatArray
    positions: FloatArray
    poses: FloatArray | None = None
    bands: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.frames)


def export(path: str | Path, track: Track, metres: bool = False) -> None:
    """Write a track to a .bvh, .trc or .csv file; one of that name is replaced at the end, when the new one is whole.

    Lengths are in the format's usual unit, BVH in cm and TRC in mm, or in metres. BVH and TRC are y-up and count
    frames and time from the first; CSV is as in the workbench, metres and z-up, with the source's frames and times.
    Raises InputError for another extension, a BVH without poses, BVH or TRC of frames at uneven times or of fewer
    than two, and where the file cannot be written.
    """
    path = Path(path)
    check_output(path)
    if path.suffix.lower() == ".csv":
        text = csv_text(track)
    elif path.suffix.lower() == ".trc":
        unit = "m" if metres else "mm"
        text = trc_text(path.name, track.skeleton.names, track.positions, _rate(path, track), unit)
    elif track.poses is None:
        raise InputError(f"{path}: BVH holds angles, but only joints are known here: write them as .trc or .csv")
    else:
        text = bvh_text(track.skeleton, track.poses, _rate(path, track), "m" if metres else "cm")
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def check_output(path: Path) -> None:
    """Raise InputError where `path` is not the name of a file to export to, in a folder that exists."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected a file to write that ends in {', '.join(SUFFIXES)}")
    if not path.parent.is_dir() or path.is_dir():
        raise InputError(f"{path}: expected the name of a file in a folder that exists")


def trc_text(file_name: str, names: Sequence[str], positions: FloatArray, rate_hz: float, unit: str = "mm") -> str:
    """Write joints (F, J, 3), m in the world, as markers of a TRC file at `rate_hz` Hz, lengths in `unit`: "mm" or "m".

    The format is that of OpenSim's documentation, "Marker (.trc) Files": three lines of header, two of column labels,
    an empty one, then one line a frame: its number from 1, its time, and x, y, z of every marker; tabs between.
    file_name: what the file says it is called. names: J, without blanks. The axes are those of our BVH files: y up,
    and z ahead where the world has x. A missing joint (NaN) is written as nan. Raises ValueError for another unit.
    """
    if unit not in _TRC_DIGITS:
        raise ValueError(f"the unit of a TRC file must be mm or m, found {unit!r}")
    n, rate = len(positions), f"{rate_hz:.10g}"
    header = {
        "DataRate": rate, "CameraRate": rate, "NumFrames": n, "NumMarkers": len(names), "Units": unit,
        "OrigDataRate": rate, "OrigDataStartFrame": 1, "OrigNumFrames": n,
    }  # fmt: skip
    axes = [f"{axis}{marker}" for marker in range(1, len(names) + 1) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{file_name}",
        "\t".join(header),
        "\t".join(map(str, header.values())),
        "\t".join(["Frame#", "Time", "\t\t\t".join(names)]),
        "\t".join(["", "", *axes]),
        "",
    ]
    values = (positions[..., FILE_FROM_WORLD] * PER_METRE[unit]).reshape(n, -1)
    for frame, row in enumerate(values.tolist()):
        coordinates = [f"{x:.{_TRC_DIGITS[unit]}f}" for x in row]
        lines.append("\t".join([str(frame + 1), f"{frame / rate_hz:.9f}", *coordinates]))
    return "\n".join([*lines, ""])


def csv_text(track: Track) -> str:
    """A table, one row a frame: frame, time_s, <joint>_x_m … _z_m and, where it is known, the pose: <name>_m or _rad.

    World coordinates, z up, and where they are known the ends of bands: <name>_low, <name>_high. Nine
    decimals: nanometres. A missing joint (NaN) is three empty cells.
    """
    names = ["frame", "time_s", *[f"{joint}_{axis}_m" for joint in track.skeleton.names for axis in "xyz"]]
    values = [track.times_s[:, None], track.positions.reshape(len(track), -1)]
    if track.poses is not None:
        dofs = track.skeleton.dof_names
        names += [f"{dof}_{'m' if column < _N_POSITIONS else 'rad'}" for column, dof in enumerate(dofs)]
        values.append(track.poses)
    if track.bands:
        names += list(track.bands)
        values.append(np.column_stack(list(track.bands.values())))
    rows = [
        ",".join([str(frame), *["" if math.isnan(x) else f"{x:.9f}" for x in row]])
        for frame, row in zip(track.frames.tolist(), np.hstack(values).tolist(), strict=True)
    ]
    return "\n".join([",".join(names), *rows, ""])


def frame_rate(times_s: FloatArray) -> float:
    """Frames per second of times (F,) that are even, F ≥ 2; whole where it is to the nanosecond times are kept to.

    An interval between half and one and a half of the median one is even: clocks jitter. Raises InputError otherwise.
    """
    if len(times_s) < 2:
        raise InputError(f"expected two frames or more, to know their rate, found {len(times_s)}")
    steps = np.diff(times_s)
    usual = float(np.median(steps))
    odd = np.flatnonzero((steps <= 0.5 * usual) | (steps >= 1.5 * usual))
    if usual <= 0.0 or len(odd):
        place = odd[0] if len(odd) else 0
        raise InputError(
            f"expected frames at even times, found {steps[place]:.3g} s after {times_s[place]:.3f} s where most are"
            f" {usual:.3g} s apart: only .csv keeps times as they are"
        )
    n_steps, duration = len(steps), float(times_s[-1] - times_s[0])
    rate = n_steps / duration
    whole = round(rate)
    return float(whole) if abs(n_steps - whole * duration) <= 1e-9 * whole else rate


def _rate(path: Path, track: Track) -> float:
    try:
        return frame_rate(track.times_s)
    except InputError as error:  # which knows the times, but not for which file
        raise InputError(f"{path}: {error}") from None
