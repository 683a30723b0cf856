"""OpenSim's motion files (.mot): joint angles by the names and conventions of its full-body model Rajagopal (2016)."""

import logging
import re
import warnings
from collections.abc import Collection
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward
from workbench.body.skeleton import Skeleton
from workbench.motion.formats.text import fail, number_rows, numbers, read_lines
from workbench.utils.arrays import FloatArray
from workbench.utils.input_limits import MAX_NUMBERS, check_number

log = logging.getLogger(__name__)

OPENSIM_FROM_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From x ahead, y to the left, z up to x ahead, y up, z to the right."""
_PELVIS = ("tilt", "list", "rotation")
_COORDINATES = {
    "hip_flexion": "hip_flexion", "hip_abduction": "hip_adduction", "hip_twist": "hip_rotation",
    "shoulder_flexion": "arm_flex", "shoulder_abduction": "arm_add", "shoulder_twist": "arm_rot",
    "knee_flexion": "knee_angle", "elbow_flexion": "elbow_flex", "ankle_flexion": "ankle_angle",
}  # fmt: skip
"""OpenSim's names by our parameters, both without the side."""
_KNEES = ("knee_angle_r", "knee_angle_l")
MAX_HYPEREXTENSION_DEG = 20.0
"""Beyond it a negative knee angle is flexion, as in gait2392: knees of hypermobile people reach 10° to 20°."""
_ANGLE = re.compile(rf"pelvis_({'|'.join(_PELVIS)})|({'|'.join(_COORDINATES.values())})_[lr]")


def opensim_coordinates(skeleton: Skeleton, poses: FloatArray) -> dict[str, FloatArray]:
    """Return OpenSim's coordinates (F,) of a person's poses (F, 25), or with feet (F, 27), by name, angles in degrees,
    without jumps by 360°.

    The angles are those of the joint coordinate systems of the ISB (Wu et al., J Biomech 2002 and 2005) as OpenSim's
    models order them: intrinsic rotations about z to the right, x ahead and y up. Flexion, adduction and internal
    rotation are positive on both sides, as are knee and elbow flexion, and dorsiflexion; a positive pelvis_tilt leans
    backwards. Of the
    two equivalent triples of a ball joint it is the one with smaller angles. pelvis_tx, ty and tz, m, are of the middle
    of the hips: x ahead where the world has x, y up.
    """
    world = OPENSIM_FROM_WORLD @ forward(skeleton, poses).rotations @ OPENSIM_FROM_WORLD.T
    root = world[:, 0]
    coordinates = {f"pelvis_{name}": each for name, each in zip(_PELVIS, _zxy(root), strict=True)}
    position = poses[:, :3] @ OPENSIM_FROM_WORLD.T
    coordinates |= {f"pelvis_t{axis}": position[:, k] for k, axis in enumerate("xyz")}
    for side, sign in (("right", 1.0), ("left", -1.0)):
        for joint, hinge in (("hip", "knee_flexion"), ("shoulder", "elbow_flexion")):
            relative = np.swapaxes(root, 1, 2) @ world[:, skeleton.joint(f"{side}_{joint}")]
            for turn, angles in zip(("flexion", "abduction", "twist"), _zxy(relative), strict=True):
                name = f"{_COORDINATES[f'{joint}_{turn}']}_{side[0]}"
                coordinates[name] = angles if turn == "flexion" else sign * angles
            coordinates[f"{_COORDINATES[hinge]}_{side[0]}"] = np.degrees(poses[:, skeleton.dof(f"{side}_{hinge}")])
        if skeleton.has_feet:
            ankle = np.degrees(poses[:, skeleton.dof(f"{side}_ankle_flexion")])
            coordinates[f"{_COORDINATES['ankle_flexion']}_{side[0]}"] = ankle
    return coordinates


def mot_text(
    name: str, skeleton: Skeleton, times_s: FloatArray, poses: FloatArray, undetermined: Collection[str] = ()
) -> str:
    """Return the text of a motion file of a person's poses (F, 25), or with feet (F, 27).

    Parameters
    ----------
    name : of the motion, in the file's first line.
    times_s : (F,), s; a frame with a pose of NaN is omitted.
    undetermined : parameters of the pose whose coordinates are omitted.
    """
    known = np.isfinite(poses).all(axis=1)
    omitted = _dependent(undetermined)
    columns = {key: each for key, each in opensim_coordinates(skeleton, poses[known]).items() if key not in omitted}
    header = [
        name, "version=1", f"nRows={known.sum()}", f"nColumns={len(columns) + 1}", "inDegrees=yes", "",
        "Units are S.I. units (second, meters, Newtons, ...)", "Angles are in degrees.", "", "endheader",
        "\t".join(["time", *columns]),
    ]  # fmt: skip
    rows = np.column_stack([*columns.values()]).tolist()
    lines = [
        "\t".join([f"{time_s:.9f}", *[f"{value:.8f}" for value in row]])
        for time_s, row in zip(times_s[known].tolist(), rows, strict=True)
    ]
    return "\n".join([*header, *lines, ""])


def read_mot(path: Path) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the times (F,), s, and the angles (F,), degrees, without jumps by 360°, of a motion file by name.

    Angles are those that `opensim_coordinates` names; the other columns are ignored. Knees that flex by negative
    angles change their sign, with a message. Raises InputError, with the line, if the file has no times that increase,
    or none of the angles.
    """
    lines = read_lines(path)
    end = next((k for k, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or end + 2 >= len(lines):
        fail(path, 1, "expected a motion file of OpenSim: a header up to endheader, names of columns, and rows")
    names = lines[end + 1].split()
    table = [(k, line) for k, line in enumerate(lines[end + 2 :], end + 3) if line.strip()]
    check_number(path, "numbers", len(table) * len(names), MAX_NUMBERS)

    def row(k: int) -> list[float]:
        line, text = table[k]
        return numbers(path, line, text.split(None, len(names)), len(names), "a row")

    values = number_rows(table, len(names), None, row)
    for k in np.flatnonzero(np.isnan(values).any(axis=1))[:1]:
        row(int(k))  # raises an error
    angles = {name: values[:, k] for k, name in enumerate(names) if _ANGLE.fullmatch(name)}
    if not angles:
        fail(path, end + 2, f"expected joint angles, such as knee_angle_r, found {', '.join(names[:60])}")
    if names[0] != "time" or not (np.diff(values[:, 0]) > 0.0).all():
        fail(path, end + 2, "expected times, s, that increase, in a first column time")
    is_radians = any(re.fullmatch(r"indegrees\s*=\s*no", line.strip().lower()) for line in lines[:end])
    scale = np.degrees(1.0) if is_radians else 1.0
    angles = {name: np.unwrap(scale * each, period=360.0) for name, each in angles.items()}
    flexion = np.concatenate([[0.0], *(angles[knee] for knee in _KNEES if knee in angles)])
    if -flexion.min() > max(MAX_HYPEREXTENSION_DEG, flexion.max()):
        log.warning("%s: flexion of the knees is negative, as in the model gait2392; its sign is changed", path)
        angles |= {knee: -angles[knee] for knee in _KNEES if knee in angles}
    return values[:, 0], angles


def _zxy(rotations: FloatArray) -> FloatArray:
    """Return the intrinsic angles (3, F), degrees, about z, x and y of rotations (F, 3, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # where x is at ±90°, y is 0
        first = Rotation.from_matrix(rotations).as_euler("ZXY", degrees=True).T
    second = np.stack([first[0] + 180.0, 180.0 - first[1], first[2] + 180.0])
    first, second = ((angles + 180.0) % 360.0 - 180.0 for angles in (first, second))
    smaller = np.where(np.abs(second).sum(axis=0) < np.abs(first).sum(axis=0), second, first)
    return np.unwrap(smaller, period=360.0, axis=1)


def _dependent(parameters: Collection[str]) -> set[str]:
    """Return the coordinates that depend on parameters of the pose."""
    sides = [parameter.partition("_")[::2] for parameter in parameters]
    names = {f"{_COORDINATES[name]}_{side[0]}" for side, name in sides if name in _COORDINATES}
    if any(side == "root" for side, _ in sides):
        names |= {f"pelvis_{name}" for name in (*_PELVIS, "tx", "ty", "tz")}
    return names
