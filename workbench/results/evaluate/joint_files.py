"""Motions of named joints from the files of any program: TRC, C3D, BVH, AMC, arrays and recordings; angles of MOT."""

import csv
import logging
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS, SIDES
from workbench.datasets.point_formats import read_array, read_arrays
from workbench.detections.readers.formats import LAYOUTS
from workbench.evaluation.comparison.joint_motion import JointMotion, with_pelvis
from workbench.evaluation.comparison.scores import joint_angles
from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.formats.laboratory_markers import is_laboratory_table, laboratory_markers
from workbench.motion.formats.markers import Markers, in_world, joint_centres, read_markers
from workbench.motion.formats.opensim_mot import MAX_HYPEREXTENSION_DEG, opensim_coordinates, read_mot
from workbench.motion.formats.text import fail, gap_numbers, points, read_lines
from workbench.motion.formats.trc import RawMarkers, joints_of_csv
from workbench.motion.sources import BY_FILE, Reading, read_clip
from workbench.recording.read.chunks import timed
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.person import recorded_poses, recorded_skeleton
from workbench.recording.read.reader import recording_at
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS, check_file, check_number, check_rate
from workbench.utils.input_path import expanded
from workbench.utils.run_files import RECORDING_SUFFIXES

log = logging.getLogger(__name__)

_MARKERS, _SKELETONS, _TABLES, _ARRAYS = (".trc", ".c3d"), (".bvh", ".amc"), (".csv", ".tsv"), (".npy", ".npz")
_ANGLES = ".mot"
SUFFIXES = (*_MARKERS, *_SKELETONS, *_TABLES, *_ARRAYS, _ANGLES, *RECORDING_SUFFIXES)
_SMPL = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
_H36M = (
    "pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "spine", "neck", "nose",
    "head_top", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist",
)  # fmt: skip
SEVENTEEN = {"Human3.6M": _H36M, "COCO": LAYOUTS["COCO_17"]}
_UNNAMED: Mapping[int, tuple[str, ...]] = MappingProxyType({
    22: _SMPL, 24: (*_SMPL, "left_hand", "right_hand"), 33: LAYOUTS["BLAZEPOSE_33"], 133: LAYOUTS["COCO_133"],
})  # fmt: skip
"""Names of the joints of arrays without names, by their number: of SMPL, BlazePose and COCO-WholeBody."""
_TRANSLATIONS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
"""OpenSim's coordinates that are lengths."""
_COLUMN = re.compile(r"(.+?)[ _.:-]*([xyz])(?:[ _]*[(\[]?(m|cm|mm)[)\]]?)?", re.IGNORECASE)
_MAX_TABLE = 80_000_000
"""Bytes of a table, whose cells take up to twenty times as much memory."""
_LONGEST_INTERVAL_S = 1.0
"""Frames of a motion are at most so far apart; larger differences of times are in ms, µs or ns."""
_TIMES = ("time_s", "time", "timestamp", "times_s", "t")
_RATES = ("rate_hz", "fps", "frame_rate", "framerate")
_NAMES = ("names", "joint_names", "joints_names", "keypoint_names", "labels")


def read_joints(path: Path, given: Reading = BY_FILE, truth: bool = False) -> JointMotion:
    """Return the motion of the person's joints in a file or a run's folder; of a motion file of OpenSim the angles.

    given: what the user says of the file, with the rate of any file without times. truth: of a recording the true
    joints, if it has them, instead of the estimate. Raises InputError if the file cannot
    be read, has no joint by name, or no times and no rate is given.
    """
    path = recording_at(expanded(path))
    suffix = path.suffix.lower()
    if path.name.lower().endswith(RECORDING_SUFFIXES):
        return _of_recording(path, truth)
    if suffix in _SKELETONS:
        return _of_skeleton(path, given)
    if suffix in _MARKERS:
        return _of_markers(read_markers(path, given.unit, given.up), None)
    if suffix in _TABLES + _ARRAYS:
        raw, times_s = (_table if suffix in _TABLES else _arrays)(path, given.rate_hz)
        return _of_markers(in_world(str(path), raw, given.unit, given.up), times_s)
    if suffix == _ANGLES:
        times_s, angles = read_mot(path)
        no_joints = np.empty((len(times_s), 0, 3))
        return JointMotion(str(path), (), times_s, no_joints, no_joints[None][:0], _named(angles))
    raise InputError(f"{path}: expected a motion, {', '.join(SUFFIXES)}, or a run's folder")


def _motion(
    source: Path | str, names: tuple[str, ...], times_s: FloatArray, positions: FloatArray,
    samples: FloatArray | None = None,
) -> JointMotion:  # fmt: skip
    ordered, places = with_pelvis(names, positions)
    if samples is None:
        samples = np.empty((0, *places.shape))
    motion = JointMotion(str(source), ordered, times_s, places, samples)
    _report_mirrored(motion)
    return motion


def _report_mirrored(motion: JointMotion) -> None:
    """Log a warning if the knees bend backwards, as with left-handed axes."""
    leg = [f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle")]
    if not set(leg) <= set(motion.names):
        return
    angles = joint_angles(motion.names, motion.positions)
    hip, knee, ankle = np.moveaxis(motion.of_joints(leg).positions.reshape(-1, 2, 3, 3), 2, 0)  # each (F, side, 3)
    ahead = np.cross(hip[:, :1] - hip[:, 1:], [0.0, 0.0, 1.0])
    in_front = np.sum((knee - 0.5 * (hip + ankle)) * ahead, axis=-1)
    bent = np.column_stack([angles[f"{side}_knee"] for side in SIDES]) > MAX_HYPEREXTENSION_DEG
    if np.any(bent) and np.mean(in_front[bent] < 0.0) > 0.5:
        log.warning(
            "%s: the knees bend backwards: left and right are exchanged, or the axes are left-handed (as in Unity); "
            "the joints are then a mirror image", motion.source,
        )  # fmt: skip


def _of_recording(path: Path, truth: bool) -> JointMotion:
    run = read_sound_run(path)
    skeleton = recorded_skeleton(run)
    chosen = [skeleton.joint(name) for name in JOINT_NAMES]
    if truth and len(run.true_joints.frames):
        _, times_s, positions = timed(path, "true_joints")
        return _motion(path, JOINT_NAMES, times_s, positions.astype(float)[:, chosen])
    _, times_s, poses = recorded_poses(run, skeleton)
    draws = run.draws
    samples = None if draws is None else np.stack([joints(skeleton, each)[:, chosen] for each in draws])
    motion = _motion(path, JOINT_NAMES, times_s, joints(skeleton, poses)[:, chosen], samples)
    return replace(motion, angles_deg=_named(opensim_coordinates(skeleton, poses)))


def _named(coordinates: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the angles among OpenSim's coordinates, knees and elbows by the names of `scores.joint_angles`."""
    hinges = {"knee_angle": "knee", "elbow_flex": "elbow"}
    ours = {f"{name}_{side[0]}": f"{side}_{joint}" for name, joint in hinges.items() for side in ("left", "right")}
    return {ours.get(name, name): each for name, each in coordinates.items() if name not in _TRANSLATIONS}


def _of_skeleton(path: Path, given: Reading) -> JointMotion:
    clip = read_clip(path, given)
    found = skeleton_joints(clip.joints, clip.parents.tolist(), place=path)
    if not found:
        raise InputError(f"{path}: no joint has a known name, found {', '.join(clip.joints[:60])}")
    places = clip.positions[:, [clip.joint(name) for name in found.values()]]
    return _motion(path, tuple(found), np.arange(len(clip)) / clip.rate_hz, places)


def _of_markers(markers: Markers, times_s: FloatArray | None) -> JointMotion:
    """Return the joints of markers, at times (F,), s, or else at the markers' rate from 0."""
    centres = joint_centres(markers, markers.positions)
    measured = np.isfinite(centres).any(axis=(0, 2))
    if not measured.any():
        raise InputError(f"{markers.source}: no frame has all markers of a joint")
    names, centres = tuple(np.array(JOINT_NAMES)[measured].tolist()), centres[:, measured]
    times = np.arange(len(centres)) / markers.rate_hz if times_s is None else times_s
    return _motion(markers.source, names, times, centres)


def _table(path: Path, rate_hz: float | None) -> tuple[RawMarkers, FloatArray | None]:
    """Return the joints of a table of a laboratory or of `motion_export.csv_text`, at their rate; or those of another
    table with the columns x, y and z of each joint, such as left_knee_x, and its times."""
    lines = read_lines(path)
    if is_laboratory_table(lines):
        return laboratory_markers(path, lines), None
    if {"frame", "time_s"} <= set(columns := lines[0].split(",")) and any(name.endswith("_x_m") for name in columns):
        return joints_of_csv(path, lines), None
    check_file(path, _MAX_TABLE)
    rows = list(csv.reader(lines, delimiter=max(",;\t", key=lines[0].count)))
    header, table = [cell.strip() for cell in rows[0]], [row for row in rows[1:] if any(row)]
    axes_of: dict[str, dict[str, int]] = {}
    units: dict[str, set[str]] = {}
    for k, column in enumerate(header):
        if match := _COLUMN.fullmatch(column):
            axes_of.setdefault(match[1], {})[match[2].lower()] = k
            units.setdefault(match[1], set()).add((match[3] or "").lower())
    names = [name for name, axes in axes_of.items() if len(axes) == len("xyz")]
    if not names or not table:
        fail(path, 1, "expected the columns x, y and z of each joint, such as left_knee_x, and a row for each frame")
    check_number(path, "numbers", len(table) * len(header), MAX_NUMBERS)
    chosen = [axes_of[name][axis] for name in names for axis in "xyz"]
    time = next((k for k, column in enumerate(header) if column.lower() in _TIMES), None)
    cells = [points([row[k].strip() if k < len(row) else "" for k in range(len(header))]) for row in table]
    places = [[row[k] for k in chosen] for row in cells]
    values = np.array([gap_numbers(path, k, row, len(chosen), "a frame") for k, row in enumerate(places, 2)])
    times = None if time is None else pd.to_numeric(pd.Series([row[time] for row in cells]), errors="coerce")
    times_s = _times(path, times, None, len(table), rate_hz)
    unit, *others = sorted(set().union(*(units[name] for name in names)))
    if others:
        fail(path, 1, f"expected one unit of length in the names of the columns, found {', '.join([unit, *others])}")
    return RawMarkers(names, 1.0, values.reshape(len(table), -1, 3), unit), times_s


def _arrays(path: Path, rate_hz: float | None) -> tuple[RawMarkers, FloatArray]:
    """Return the joints of an NPY or NPZ file, its only array (F, J, 3), and its times."""
    is_single = path.suffix.lower() == ".npy"
    arrays = {"array": read_array(path)} if is_single else read_arrays(path, lambda names: names)
    places = [
        name for name, each in arrays.items() if each.ndim == 3 and each.shape[2] == 3 and each.dtype.kind in "fi"
    ]
    if len(places) != 1:
        listed = ", ".join(f"{name} {each.shape}" for name, each in arrays.items())
        raise InputError(f"{path}: expected one array of joints (frames, joints, 3), found {listed or 'none'}")
    positions = arrays[places[0]].astype(float)
    names = next((arrays[key].astype(str).ravel().tolist() for key in _NAMES if key in arrays), None)
    names = names or list(_unnamed(path, positions))
    if len(names) != positions.shape[1]:
        raise InputError(
            f"{path}: expected the names of {positions.shape[1]} joints in an array 'names', found {len(names)}; "
            f"without names, only {', '.join(map(str, [*_UNNAMED, len(_H36M)]))} joints are known"
        )
    times, rate = (next((arrays[key] for key in keys if key in arrays), None) for keys in (_TIMES, _RATES))
    times_s = _times(path, times, None if rate is None else float(np.ravel(rate)[0]), len(positions), rate_hz)
    return RawMarkers(names, 1.0, positions, ""), times_s


def _unnamed(path: Path, positions: FloatArray) -> tuple[str, ...]:
    """Return the names of the joints of an array (F, J, 3) without names, by their number; of 17 by the limbs, whose
    lengths are constant and equal on both sides."""
    if positions.shape[1] != len(_H36M):
        return _UNNAMED.get(positions.shape[1], ())

    def spread(names: tuple[str, ...]) -> float:
        ends = [[[names.index(f"{side}_{end}") for side in SIDES] for end in limb] for limb in LIMBS.values()]
        near, far = np.moveaxis(positions[:, ends], 2, 0)  # each (F, limb, side, 3)
        lengths = np.linalg.norm(near - far, axis=-1)
        return float(np.mean(np.nanstd(lengths, axis=(0, 2)) / np.nanmean(lengths, axis=(0, 2))))

    best = min(SEVENTEEN, key=lambda each: spread(SEVENTEEN[each]))
    log.info("%s: 17 joints without names, read as those of %s by the lengths of the limbs", path, best)
    return SEVENTEEN[best]


def _times(path: Path, times_s: FloatArray | None, rate_hz: float | None, n: int, given_hz: float | None) -> FloatArray:
    """Return the times (n,), s, by the user's rate, the file's times or the file's rate."""
    if given_hz is None and times_s is not None:
        times = np.asarray(times_s, dtype=float).ravel()
        if len(times) != n or not np.isfinite(times).all() or not (np.diff(times) > 0.0).all():
            raise InputError(f"{path}: expected {n} times, s, that increase, or give the rate: --rate HZ")
        interval = float(np.median(np.diff(times))) if n > 1 else 0.0
        thousands = math.ceil(round(math.log(interval, 1000), 9)) if interval > _LONGEST_INTERVAL_S else 0
        if thousands > 0:
            log.warning("%s: frames are %g apart, times read in 10^-%d s", path, interval, 3 * thousands)
        return times / 1000.0**thousands
    rate = given_hz or rate_hz
    if rate is None:
        raise InputError(f"{path}: has no times; give its rate: --rate HZ")
    return np.arange(n) / check_rate(f"{path}: the rate", rate)
