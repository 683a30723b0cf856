"""Export of tracked joints to files for Blender (BVH), OpenSim (TRC, MOT), Mokka (C3D) or spreadsheets (CSV)."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from workbench.body.angles import N_POSITION
from workbench.body.skeleton import Skeleton
from workbench.motion.formats.bvh import PER_METRE, bvh_text
from workbench.motion.formats.c3d import check_c3d_installed, write_c3d
from workbench.motion.formats.opensim_mot import OPENSIM_FROM_WORLD, mot_text
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

SUFFIXES = (".bvh", ".trc", ".csv", ".c3d", ".mot")
_TRC_DIGITS = {"mm": 4, "m": 7}  # a tenth of a micrometre
_ONE_RATE = (".bvh", ".trc", ".c3d")
_ROUNDING_S = 1e-3
"""Largest deviation of a constant rate's timestamps, which Matroska rounds to whole milliseconds."""
_SAME_S = 1e-9
"""Times that differ by less are equal but for rounding."""
MAX_GAP_S = 0.5
"""Longest interval over which a motion is interpolated, as in `visible_frames`."""
_MAX_FRAMES = 1_000_000
"""Of an export with its missing frames, 9 h at 30 Hz."""


@dataclass(frozen=True, eq=False)
class Track:
    """F frames of the J joints of a skeleton, in the world.

    frames : (F,), their numbers in the source. times_s : (F,), increasing. positions : (F, J, 3), m. poses : (F, P), m
    and rad, with these positions; None if only the joints are known. bands : (F,) by name, limits of 90 % credible
    intervals of single parameters, in their units; exported to CSV only. undetermined : parameters of the poses that
    no observation determines.
    """

    skeleton: Skeleton
    frames: IntArray
    times_s: FloatArray
    positions: FloatArray
    poses: FloatArray | None = None
    bands: Mapping[str, FloatArray] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def markers(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names (M,) and positions (F, M, 3), m, of the joints but for those at the place of their parent, such as the
        one that carries a foot at the ankle."""
        skeleton = self.skeleton
        rows = np.flatnonzero((skeleton.parents < 0) | skeleton.offsets.any(axis=1))
        return tuple(skeleton.names[row] for row in rows), self.positions[:, rows]


def export(path: str | Path, track: Track, metres: bool = False) -> None:
    """Write a track to a file of one of SUFFIXES, atomically; an existing file is replaced.

    Lengths are in the format's usual unit, BVH in cm, TRC and C3D in mm, or in metres. BVH and TRC are y-up and count
    frames and time from the first; C3D is z-up; for MOT see `opensim_coordinates`; CSV is as in the workbench, metres
    and z-up, with the source's frames and times. BVH, TRC and C3D have one rate: frames at unequal intervals are
    resampled for them, see `at_one_rate`. Missing frames (NaN) and undetermined joints are empty in CSV and TRC,
    NaN in C3D and omitted in MOT; in BVH a missing frame repeats the pose before it, with a message.
    Raises InputError for another extension, a BVH or MOT without poses, BVH, TRC or C3D of fewer than two frames or of
    times that do not increase, C3D without ezc3d, or the file cannot be written.
    """
    path = Path(path)
    check_output(path)
    if path.suffix.lower() in _ONE_RATE:
        try:
            equidistant = at_one_rate(track)
        except InputError as error:  # add the file to the message
            raise InputError(f"{path}: {error}") from None
        if equidistant is not track:
            rate_hz = frame_rate(equidistant.times_s)
            log.warning("%s: frames at unequal intervals; resampled at %.6g Hz", path, rate_hz)
        track = equidistant
    with whole_file(path, parents=True) as part:
        if path.suffix.lower() == ".c3d":
            unit, target = "m" if metres else "mm", part.with_suffix(".c3d")  # ezc3d appends it to other names
            write_c3d(target, *track.markers, frame_rate(track.times_s), unit, PER_METRE[unit])
            target.replace(part)
        else:
            part.write_text(_text(path, track, metres), encoding="utf-8", newline="\n")


def _text(path: Path, track: Track, metres: bool) -> str:
    """Return the text of a file by its extension; raises InputError as `export` does."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return csv_text(track)
    if suffix == ".trc":
        unit = "m" if metres else "mm"
        return trc_text(path.name, *track.markers, frame_rate(track.times_s), unit)
    if track.poses is None:
        raise InputError(
            f"{path}: {suffix[1:].upper()} requires joint angles, but only joint positions are known; choose .trc, "
            ".c3d or .csv"
        )
    if suffix == ".mot":
        since_first_s = track.times_s - track.times_s[:1]
        return mot_text(path.stem, track.skeleton, since_first_s, track.poses, track.undetermined)
    return bvh_text(
        track.skeleton, _held(path, track.frames, track.poses), frame_rate(track.times_s), "m" if metres else "cm"
    )


def with_missing_frames(track: Track) -> Track:
    """Return a track with NaN in the frames that are omitted between its numbers, up to _MAX_FRAMES in all."""
    if len(track) < 2:
        return track
    step = max(int(np.gcd.reduce(np.diff(track.frames))), 1)
    rows = (track.frames - track.frames[0]) // step
    if rows[-1] + 1 == len(track) or rows[-1] >= _MAX_FRAMES:
        return track

    def expanded(values: FloatArray) -> FloatArray:
        whole = np.full((rows[-1] + 1, *values.shape[1:]), np.nan)
        whole[rows] = values
        return whole

    frames = track.frames[0] + step * np.arange(rows[-1] + 1)
    return replace(
        track, frames=frames, times_s=np.interp(frames, track.frames, track.times_s),
        positions=expanded(track.positions), poses=None if track.poses is None else expanded(track.poses),
        bands={name: expanded(values) for name, values in track.bands.items()},
    )  # fmt: skip


def _held(path: Path, frames: IntArray, poses: FloatArray) -> FloatArray:
    """Return poses (F, P) with the pose before in place of missing ones (NaN)."""
    missing = np.isnan(poses).any(axis=1)
    if missing.any():
        listed = f"{missing.sum()} frames between {frames[missing][0]} and {frames[missing][-1]}"
        log.warning("%s: no pose is known in %s; BVH cannot omit them, so they repeat the pose before", path, listed)
    return poses[np.maximum.accumulate(np.where(missing, 0, np.arange(len(poses))))]


def check_output(path: Path) -> None:
    """Raise InputError unless `path` has a supported extension, whose library is installed, and is no folder."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected an output file with the extension {', '.join(SUFFIXES)}")
    if path.is_dir():
        raise InputError(f"{path}: expected an output file, found a folder")
    if path.suffix.lower() == ".c3d":
        check_c3d_installed(path)


def trc_text(file_name: str, names: Sequence[str], positions: FloatArray, rate_hz: float, unit: str = "mm") -> str:
    """Return the text of a TRC file with joints (F, J, 3), m in the world, as markers.

    The format is that of OpenSim's documentation, "Marker (.trc) Files": three lines of header, two of column labels,
    an empty one, then one line per frame: its number from 1, its time, and x, y, z of every marker, separated by tabs.
    The axes are OpenSim's, as those of MOT files: x ahead where the world has x, y up, z to the right. A missing joint
    (NaN) is three empty cells.
    file_name : in the header. names : J, without blanks. unit : "mm" or "m".
    """
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
    values = ((positions @ OPENSIM_FROM_WORLD.T + 0.0) * PER_METRE[unit]).reshape(n, -1)
    for frame, row in enumerate(values.tolist()):
        coordinates = ["" if math.isnan(x) else f"{x:.{_TRC_DIGITS[unit]}f}" for x in row]
        lines.append("\t".join([str(frame + 1), f"{frame / rate_hz:.9f}", *coordinates]))
    return "\n".join([*lines, ""])


def csv_text(track: Track) -> str:
    """Return a table with one row per frame: frame, time_s, <joint>_x_m … _z_m and, if known, <parameter>_m or _rad.

    Coordinates are in the world, z up. If known, limits of intervals follow: <name>_low, <name>_high. Nine decimals:
    nanometres. A missing joint (NaN) is three empty cells, an undetermined parameter an empty one.
    """
    joints, positions = track.markers
    names = ["frame", "time_s", *[f"{joint}_{axis}_m" for joint in joints for axis in "xyz"]]
    values = [track.times_s[:, None], positions.reshape(len(track), -1)]
    if track.poses is not None:
        dofs = track.skeleton.dof_names
        names += [f"{dof}_{'m' if column < N_POSITION else 'rad'}" for column, dof in enumerate(dofs)]
        values.append(np.where(np.isin(dofs, track.undetermined), np.nan, track.poses))
    if track.bands:
        names += list(track.bands)
        values.append(np.column_stack(list(track.bands.values())))
    rows = [
        ",".join([str(frame), *["" if math.isnan(x) else f"{x:.9f}" for x in row]])
        for frame, row in zip(track.frames.tolist(), np.hstack(values).tolist(), strict=True)
    ]
    return "\n".join([",".join(names), *rows, ""])


def frame_rate(times_s: FloatArray) -> float:
    """Return the mean frame rate, Hz, of times (F,), F ≥ 2; an integer if it is one to the nanosecond."""
    n_steps, duration = len(times_s) - 1, float(times_s[-1] - times_s[0])
    rate = n_steps / duration
    whole = round(rate)
    return float(whole) if abs(n_steps - whole * duration) <= 1e-9 * whole else rate


def at_one_rate(track: Track) -> Track:
    """Return a track at equal intervals, of the median rate where its own intervals are unequal.

    Times count as equal intervals if they deviate by at most _ROUNDING_S. Positions and angles are interpolated
    linearly; a frame next to a missing one, or in an interval of more than MAX_GAP_S, is missing.

    Raises
    ------
    InputError
        For fewer than two frames, times that do not increase, and more than _MAX_FRAMES frames.
    """
    times_s = track.times_s
    if len(times_s) < 2:
        raise InputError(f"expected two frames or more to determine their rate, found {len(times_s)}")
    steps_s = np.diff(times_s)
    if (steps_s <= 0.0).any():
        k = int(np.argmax(steps_s <= 0.0))
        raise InputError(f"expected times that increase, found {steps_s[k]:.3g} s after {times_s[k]:.3f} s")
    equal_s = np.linspace(times_s[0], times_s[-1], len(times_s))
    if np.abs(times_s - equal_s).max() <= _ROUNDING_S:
        return track
    interval_s = float(np.median(steps_s))
    n = int((times_s[-1] - times_s[0]) / interval_s + 1e-6) + 1
    if n > _MAX_FRAMES:
        raise InputError(f"expected at most {_MAX_FRAMES} frames at {1.0 / interval_s:.6g} Hz, found {n}")
    new_s = times_s[0] + interval_s * np.arange(n)
    poses = track.poses
    if poses is not None:
        poses = np.column_stack([poses[:, :N_POSITION], _unwrapped(poses[:, N_POSITION:])])
    return Track(
        track.skeleton, np.arange(n), new_s, _interpolated(times_s, track.positions, new_s),
        None if poses is None else _interpolated(times_s, poses, new_s), undetermined=track.undetermined,
    )  # fmt: skip


def _unwrapped(angles: FloatArray) -> FloatArray:
    """Return angles (F, K) without jumps by whole turns, NaN in missing frames."""
    known = np.isfinite(angles).all(axis=1)
    unwrapped = angles.copy()
    unwrapped[known] = np.unwrap(angles[known], axis=0)
    return unwrapped


def _interpolated(times_s: FloatArray, values: FloatArray, new_s: FloatArray) -> FloatArray:
    """Return values (F, ...) at new times (G,) within the old ones (F,), as `at_one_rate` does."""
    after = np.clip(np.searchsorted(times_s, new_s - _SAME_S), 1, len(times_s) - 1)
    ends = np.stack([times_s[after - 1], times_s[after]])
    at_frame = np.abs(ends - new_s) < _SAME_S
    new_s = np.where(at_frame[0], ends[0], np.where(at_frame[1], ends[1], new_s))
    columns = [np.interp(new_s, times_s, column) for column in values.reshape(len(values), -1).T]
    mixed = np.stack(columns, axis=1).reshape(len(new_s), *values.shape[1:])
    mixed[~at_frame.any(axis=0) & (ends[1] - ends[0] > MAX_GAP_S + _SAME_S)] = np.nan
    return mixed
