"""Motion capture of HumanEva: Vicon's markers and segments in C3D files, and the benchmark's virtual markers by them.

The definitions are those of the benchmark's evaluation (Sigal, Balan & Black, IJCV 87, 2010, and its release notes):
joint centres and axes of Plug-in Gait's segments, with the torso and the arms turned by the measured radii.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.units import UNITS
from workbench.core.frame import HUMANEVA_HEAD_M
from workbench.motion.formats.c3d import read_c3d
from workbench.motion.formats.text import read_lines
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

_PELVIS_BACK_M, _MARKER_RADIUS_M = 0.05, 0.007
_HEAD_MARKERS = ("LFHD", "RFHD", "LBHD", "RBHD")
_MARKERS = (
    *_HEAD_MARKERS, "C7", "T10", "CLAV", "STRN", "RBAK",
    *(f"{side}{name}" for side in "LR" for name in (
        "SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN", "ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE",
    )),
)  # fmt: skip
"""The 39 markers without any of which a frame is invalid."""
_OTHER_NAMES = {"LFRM": "LFRA", "RFRM": "RFRA"}
_ORIGINS = {
    "hip": "FEP", "knee": "FEO", "ankle": "TIO", "shoulder": "CLO", "elbow": "HUO", "wrist": "RAO",
}  # fmt: skip
"""Joint centres of a side among the points of Plug-in Gait's segments."""
_SEGMENTS = ("PEL", "HED", "LFE", "RFE", "LTI", "RTI", "LHU", "RHU", "LRA", "RRA")
"""Segments with the points O (origin), and A, L and P on its axes x (ahead), y (left) and z (proximal)."""
_POINTS = (
    "TRXO", *(f"{side}{name}" for side in "LR" for name in _ORIGINS.values()),
    *(f"{segment}{end}" for segment in _SEGMENTS for end in "OALP"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Capture:
    """Points of one trial.

    names : of M markers and points of segments. positions : (F, M, 3), m, z up, NaN where missing. torso_radius_m :
    half of the shoulders' distance in the static trial, without the markers. shoulder_offsets_m : of the left and the
    right shoulder marker from the joint.
    """

    names: tuple[str, ...]
    positions: FloatArray
    torso_radius_m: float
    shoulder_offsets_m: tuple[float, float]

    def of(self, *names: str) -> FloatArray:
        """Return the positions (F, n, 3) of points."""
        return self.positions[:, [self.names.index(name) for name in names]]

    @cached_property
    def is_valid(self) -> BoolArray:
        """Whether all 39 markers, and the points of the segments, are measured in a frame (F,)."""
        return np.asarray(np.isfinite(self.of(*_MARKERS, *_POINTS)).all(axis=(1, 2)))


def read_capture(motion: Path, static: Path, measurements: Path) -> Capture:
    """Return the points of a trial.

    Parameters
    ----------
    motion, static : C3D files of the trial and of the person who stands.
    measurements : Vicon's .mp file of the person.

    Raises
    ------
    InputError : a file cannot be read, or lacks a marker, a point of a segment or a measurement.
    """
    names, positions = _points(motion, (*_MARKERS, *_POINTS))
    _, shoulders = _points(static, ("LSHO", "RSHO"))
    width = float(np.nanmean(np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=-1)))
    text = "\n".join(read_lines(measurements))
    offsets = [_measurement(measurements, text, f"{side}ShoulderOffset") for side in "LR"]
    return Capture(names, positions, 0.5 * width - _MARKER_RADIUS_M, (offsets[0], offsets[1]))


def _points(path: Path, wanted: tuple[str, ...]) -> tuple[tuple[str, ...], FloatArray]:
    """Return the wanted names and the points (F, M, 3), m, NaN where missing: the file has a gap or 0 0 0."""
    raw = read_c3d(path)
    index = {name.rpartition(":")[2].strip().upper(): k for k, name in reversed(list(enumerate(raw.names)))}
    index |= {name: index[other] for name, other in _OTHER_NAMES.items() if name not in index and other in index}
    if missing := [name for name in wanted if name not in index]:
        raise InputError(f"{path}: expected Plug-in Gait's markers and segments, as in HumanEva, found no {missing[0]}")
    positions = raw.positions[:, [index[name] for name in wanted]] * UNITS.get(raw.unit, UNITS["mm"])
    return wanted, np.where((positions == 0.0).all(axis=-1, keepdims=True), np.nan, positions)


def _measurement(path: Path, text: str, name: str) -> float:
    """Return a length of Vicon's file of measurements, whose lines are "$name = mm", in m."""
    match = re.search(rf"^\s*\$?{name}\s*=\s*(-?[\d.]+)\s*$", text, re.MULTILINE)
    if match is None:
        raise InputError(f"{path}: expected a line ${name} = millimetres, found none")
    return 1e-3 * float(match[1])


def virtual_markers(capture: Capture, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the benchmark's virtual markers, and the centres of the head's markers, in frames between those captured.

    Parameters
    ----------
    capture : the trial.
    rows : (T,) positions in its frames, from 0, with fractions.

    Returns
    -------
    (T, J, 2, 3), m, of JOINT_NAMES: the ends of the two limbs that meet in the thorax (as the neck), an elbow or a
    knee, else twice the same point; the head's is its top. (T, 3), m. Both are NaN where a frame next to the row is
    invalid.
    """
    low, high = np.floor(rows).astype(int), np.ceil(rows).astype(int)
    inside = (low >= 0) & (high < len(capture.positions))
    low, high = np.where(inside, low, 0), np.where(inside, high, 0)
    chosen = np.flatnonzero(inside & capture.is_valid[low] & capture.is_valid[high])
    between = _Between(capture, low[chosen], high[chosen], (rows - np.floor(rows))[chosen])
    markers, heads = np.full((len(rows), len(JOINT_NAMES), 2, 3), np.nan), np.full((len(rows), 3), np.nan)
    ends = _torso(between) | {
        f"{side}_{name}": pair
        for side, radius_m in zip(("left", "right"), capture.shoulder_offsets_m, strict=True)
        for name, pair in (_leg(between, side[0].upper()) | _arm(between, side[0].upper(), radius_m)).items()
    }
    markers[chosen] = np.stack([np.stack(ends[name], axis=1) for name in JOINT_NAMES], axis=1)
    heads[chosen] = np.mean([between.point(name) for name in _HEAD_MARKERS], axis=0)
    return markers, heads


_Ends = dict[str, tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class _Between:
    """Interpolation between valid frames low and high (T,) of a capture, at a fraction (T,) of the way."""

    capture: Capture
    low: IntArray
    high: IntArray
    fraction: FloatArray

    def point(self, name: str) -> FloatArray:
        """Return a point (T, 3), interpolated linearly."""
        places = self.capture.of(name)[:, 0]
        return places[self.low] + self.fraction[:, None] * (places[self.high] - places[self.low])

    def length(self, first: str, second: str) -> FloatArray:
        """Return the mean distance (T,) of two points in both frames."""
        distances = np.linalg.norm(np.diff(self.capture.of(first, second), axis=1)[:, 0], axis=-1)
        return 0.5 * (distances[self.low] + distances[self.high])

    def turned(self, segment: str, vectors: FloatArray) -> FloatArray:
        """Return vectors (T, 3) in a segment's axes as vectors in the world; the axes are interpolated spherically."""
        points = self.capture.of(*(f"{segment}{end}" for end in "OALP"))
        axes = np.swapaxes(points[:, 1:] - points[:, :1], 1, 2)  # as columns; from_matrix makes them orthogonal
        axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        first, second = (Rotation.from_matrix(axes[rows]) for rows in (self.low, self.high))
        step = Rotation.from_rotvec(self.fraction[:, None] * (first.inv() * second).as_rotvec())
        return (first * step).apply(vectors)


def _vectors(x: FloatArray, z: FloatArray) -> FloatArray:
    return np.stack([x, np.zeros_like(x), z], axis=-1)


def _torso(between: _Between) -> _Ends:
    length, thorax = between.length("TRXO", "PELO"), between.point("TRXO")
    back, tilt = np.full_like(length, -_PELVIS_BACK_M), np.arctan2(0.5 * between.capture.torso_radius_m, length)
    pelvis = between.point("PELO") + between.turned("PEL", _vectors(back, np.zeros_like(length)))
    top = pelvis + between.turned("PEL", _vectors(-length * np.sin(tilt), length * np.cos(tilt)))
    head = thorax + between.turned("HED", _vectors(np.zeros_like(length), np.full_like(length, HUMANEVA_HEAD_M)))
    return {"pelvis": (pelvis, pelvis), "neck": (top, thorax), "head_centre": (head, head)}


def _leg(between: _Between, side: str) -> _Ends:
    hip, knee, ankle = (f"{side}{_ORIGINS[name]}" for name in ("hip", "knee", "ankle"))
    zero = np.zeros(len(between.low))
    thigh = between.turned(f"{side}FE", _vectors(zero, -between.length(hip, knee)))
    calf = between.turned(f"{side}TI", _vectors(zero, -between.length(knee, ankle)))
    start, middle = between.point(hip), between.point(knee)
    return {"hip": (start, start), "knee": (start + thigh, middle), "ankle": (middle + calf, middle + calf)}


def _arm(between: _Between, side: str, radius_m: float) -> _Ends:
    """Return the ends of an arm, whose segments are turned by half of the shoulder's radius over the upper arm."""
    shoulder, elbow, wrist = (f"{side}{_ORIGINS[name]}" for name in ("shoulder", "elbow", "wrist"))
    upper, lower = between.length(shoulder, elbow), between.length(elbow, wrist)
    tilt, start = np.arctan2(0.5 * radius_m, upper), between.point(shoulder)
    end = start + between.turned(f"{side}HU", _vectors(-upper * np.sin(tilt), -upper * np.cos(tilt)))
    untilted = start + between.turned(f"{side}HU", _vectors(np.zeros_like(upper), -upper))
    middle = end + between.point(elbow) - untilted
    hand = middle + between.turned(f"{side}RA", _vectors(lower * np.sin(tilt), -lower * np.cos(tilt)))
    return {"shoulder": (start, start), "elbow": (end, middle), "wrist": (hand, hand)}
