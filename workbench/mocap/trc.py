"""TRC text of joints as markers, as OpenSim reads it.

The format: OpenSim's documentation, "Marker (.trc) Files". Three lines of header, two of column labels, an empty one,
then one line a frame: its number from 1, its time (number − 1) / DataRate, and x, y, z of every marker; tabs between.
"""

from collections.abc import Sequence

from workbench.arrays import FloatArray
from workbench.mocap.bvh_writer import FILE_FROM_WORLD, PER_METRE

_DIGITS = {"mm": 4, "m": 7}  # a tenth of a micrometre


def trc_text(file_name: str, names: Sequence[str], positions: FloatArray, rate_hz: float, unit: str = "mm") -> str:
    """The TRC file of joints (F, J, 3), m in the world, at `rate_hz` frames per second; lengths in `unit`, "mm" or "m".

    file_name: what the file says it is called. names: J, without blanks. The axes are those of our BVH files: y up,
    and z ahead where the world has x. A missing joint (NaN) is written as nan. Raises ValueError for another unit.
    """
    if unit not in _DIGITS:
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
        lines.append("\t".join([str(frame + 1), f"{frame / rate_hz:.9f}", *[f"{x:.{_DIGITS[unit]}f}" for x in row]]))
    return "\n".join([*lines, ""])
