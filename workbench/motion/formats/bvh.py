"""BVH files: a hierarchy of joints, then one line of channel values per frame.

BVH has no specification; the output follows Biovision's files and is readable by this reader and by Blender.
"""

import logging
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from workbench.body.angles import N_POSITION
from workbench.body.skeleton import Skeleton
from workbench.body.units import UNITS
from workbench.motion.clip import FILE_FROM_WORLD, MotionClip
from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.formats.person_clip import person_clip
from workbench.motion.formats.text import (
    Statement,
    fail,
    gap_numbers,
    last_values,
    number_rows,
    numbers,
    points,
    read_lines,
    report_count,
    statements,
)  # fmt: skip
from workbench.utils import input_limits
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.input_limits import MAX_FRAMES, MAX_JOINTS, check_number

log = logging.getLogger(__name__)

PER_METRE = {unit: 1.0 / UNITS[unit] for unit in ("m", "cm", "mm")}
_POSITIONS = ("Xposition", "Yposition", "Zposition")
_ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
_COMMENT = re.compile(r"\s*(#|$)")  # or a blank line
_DIGITS = 6  # a millionth of a degree moves a hand by 10 nm


@dataclass
class _Joint:
    name: str
    parent: int
    is_end: bool
    offset: list[float] | None = None
    channels: tuple[str, ...] = ()


def read_bvh(
    path: str | Path, unit: str | None = None, up: str | None = None, landmarks: Mapping[str, str] | None = None
) -> MotionClip:
    """Return the clip of a BVH file.

    A joint has rotation channels, position channels or both, in any order, or none; its rotation is intrinsic, in the
    order of its channels. Positions replace the joint's offset (of the root too, whose offset is zero in most files).
    End sites become joints <parent>_end. Of several roots the one with most of a person's joints is read. A frame time
    that equals 1/N s to its printed digits means N Hz. A value that is not a number repeats the channel's last one.

    Parameters
    ----------
    path : the file.
    unit, up : unit of length (`units.UNITS`) and vertical axis; None: by the person's size and posture, by
        convention cm and y.
    landmarks : the file's joints by the person's joints, where `joint_names` does not have them.

    Raises
    ------
    InputError : with the file and the line, for other content and a truncated row, and for an implausible size.
    """
    path = Path(path)
    lines = read_lines(path)
    joints, line = _read_hierarchy(path, lines)
    rate_hz, values = _read_motion(path, lines, line, sum(len(joint.channels) for joint in joints))
    names, parents, columns = _person(path, joints, landmarks)
    offsets, rotations, translations = _local_motion([joints[k] for k in columns], list(columns.values()), values)
    return person_clip(path, rate_hz, names, parents, offsets, rotations, translations, "cm", unit, up, landmarks)


def _person(
    path: Path, joints: list[_Joint], landmarks: Mapping[str, str] | None
) -> tuple[tuple[str, ...], IntArray, dict[int, int]]:
    """Return the names and parents of the joints below the root with most of a person's joints, and the first column
    of each of these joints, by its index in the file."""
    firsts = np.cumsum([0, *[len(joint.channels) for joint in joints]]).tolist()
    starts = [k for k, joint in enumerate(joints) if joint.parent < 0]
    people = []
    for start, end in zip(starts, [*starts[1:], len(joints)], strict=True):
        names = tuple(joint.name for joint in joints[start:end])
        parents = [joint.parent - start if joint.parent >= 0 else -1 for joint in joints[start:end]]
        found = skeleton_joints(names, parents) if landmarks is None else set(landmarks.values()) & set(names)
        people.append((len(found), names, np.array(parents), {k: firsts[k] for k in range(start, end)}))
    _, names, parent_array, columns = max(people, key=lambda person: person[0])
    if len(people) > 1:
        log.warning("%s: %d roots; read is %s with its %d joints", path, len(people), names[0], len(names))
    return names, parent_array, columns


def _local_motion(
    joints: list[_Joint], firsts: list[int], values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return offsets (K, 3), rotations (F, K, 3, 3) and translations (F, K, 3) of joints to their parents, in the
    file's unit and axes. firsts : each joint's first column of the values."""
    offsets = np.array([joint.offset for joint in joints])
    translations = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    rotations = np.broadcast_to(np.eye(3), (*translations.shape, 3)).copy()
    for k, (joint, first) in enumerate(zip(joints, firsts, strict=True)):
        channels = dict(zip(joint.channels, values[:, first : first + len(joint.channels)].T, strict=True))
        if rotation_channels := [name for name in joint.channels if name in _ROTATIONS]:
            order: Any = "".join(name[0] for name in rotation_channels)  # upper case means intrinsic in scipy
            angles = np.stack([channels[name] for name in rotation_channels], axis=-1)
            rotations[:, k] = scipy.spatial.transform.Rotation.from_euler(order, angles, degrees=True).as_matrix()
        for axis, name in enumerate(_POSITIONS):
            if name in channels:
                translations[:, k, axis] = channels[name]
    return offsets, rotations, translations


def _read_hierarchy(path: Path, lines: list[str]) -> tuple[list[_Joint], int]:
    """Return the joints, and the index of the line after MOTION."""
    rows = _statements(lines)
    line, words = next(rows, (1, [""]))
    if [word.upper() for word in words] != ["HIERARCHY"]:
        fail(path, line, f"expected HIERARCHY, found {' '.join(words)[:60]!r}")
    joints: list[_Joint] = []
    branch: list[int] = []  # joints with open braces
    is_new = False  # the last joint has no opening brace yet
    for line, words in rows:
        joint, found = joints[branch[-1]] if branch else None, repr(" ".join(words)[:60])
        if is_new != (words == ["{"]):
            fail(path, line, f"expected {'{' if is_new else 'a statement'}, found {found}")
        match [words[0].upper(), *words[1:]]:
            case ["MOTION"]:
                if branch or not joints:
                    fail(path, line, "expected a ROOT, and the closing brace of every joint, before MOTION")
                return joints, line
            case ["{"]:
                branch.append(len(joints) - 1)
                is_new = False
            case ["ROOT" | "JOINT" | "END" | "ENDSITE" as kind, *name] if joint is None or not joint.is_end:
                if (joint is None) != (kind == "ROOT"):
                    fail(path, line, f"expected a ROOT, and joints between its braces, found {found}")
                joints.append(_new_joint(path, line, joints, kind, " ".join(name), branch[-1] if branch else -1))
                is_new = True
            case ["OFFSET", *offset] if joint:
                joint.offset = numbers(path, line, points(offset), 3, f"the offset of {joint.name}")
            case ["CHANNELS", *channels] if joint and not joint.is_end:
                joint.channels = _channels(path, line, channels, joint.name)
            case ["}"] if joint:
                if joint.offset is None:
                    fail(path, line, f"expected the OFFSET of {joint.name} before its end")
                branch.pop()
            case _:
                fail(path, line, f"expected a statement of the hierarchy here, found {found}")
    fail(path, len(lines), "expected MOTION, found the end of the file")


def _statements(lines: list[str]) -> Iterator[Statement]:
    """Yield the number and words of the lines; a brace at the end of a joint's line is separate."""
    for line, words in statements(lines):
        if len(words) > 1 and words[-1] == "{":
            yield line, words[:-1]
            words = ["{"]
        yield line, words


def _new_joint(path: Path, line: int, joints: list[_Joint], kind: str, name: str, parent: int) -> _Joint:
    if is_end := kind.startswith("END"):
        name = f"{joints[parent].name}_end"  # End Site, which some programs name
    if not name:
        fail(path, line, f"expected a joint's name, found {name!r}")
    root = max((k for k, joint in enumerate(joints) if joint.parent < 0), default=0) if parent >= 0 else len(joints)
    names, n, first = {joint.name for joint in joints[root:]}, 2, name
    while name in names:  # several end sites of a joint, or one name of two fingers
        name, n = f"{first}_{n}", n + 1
    check_number(path, "joints", len(joints) + 1, MAX_JOINTS)
    return _Joint(name, parent, is_end)


def _channels(path: Path, line: int, words: list[str], joint: str) -> tuple[str, ...]:
    """Return the names of a joint's channels; words : their number, then the names."""
    names = tuple(word.capitalize() for word in words[1:])
    if words[:1] != [str(len(names))] or len(set(names)) < len(names) or not set(names) <= {*_POSITIONS, *_ROTATIONS}:
        found = " ".join(words)[:80]
        fail(path, line, f"expected the number of rotations and positions of {joint}, and their names, found {found!r}")
    return names


def _read_motion(path: Path, lines: list[str], start: int, n_channels: int) -> tuple[float, FloatArray]:
    """Return the rate, Hz, and the channel values (F, n_channels) of the lines after MOTION."""
    rows = [(k, text) for k, text in enumerate(lines[start:], start + 1) if not _COMMENT.match(text)]
    end = [(len(lines), "the end of the file")] * 2
    (count_line, count), (time_line, time) = [*rows[:2], *end][:2]
    n_frames = _header(path, count_line, count.split(), "Frames:", "a whole number of frames")
    rate_hz = _rate(path, time_line, _header(path, time_line, time.split(), "Frame Time:", "seconds a frame"))
    rows = rows[2:]
    if not rows:
        fail(path, time_line, "expected lines of frames after the header, found none")
    report_count(path, int(n_frames), len(rows))
    check_number(path, "frames", len(rows), MAX_FRAMES)
    check_number(path, "values", len(rows) * n_channels, input_limits.MAX_VALUES)

    def row(k: int) -> list[float]:
        line, text = rows[k]
        return gap_numbers(path, line, points(text.split(None, n_channels)), n_channels, f"frame {k + 1}")

    return rate_hz, last_values(path, number_rows(rows, n_channels, None, row))


def _header(path: Path, line: int, words: list[str], key: str, what: str) -> Decimal:
    """Return the number after `key`, above 0 and below 1e9, with its printed digits; whole where `key` is Frames."""
    text = " ".join(words)
    number = re.fullmatch(key.replace(" ", r"\s*").replace(":", r"\s*:?\s*") + r"(\S+)", text, re.IGNORECASE)
    try:
        value = Decimal(number[1].replace(",", ".")) if number else Decimal(0)
    except InvalidOperation:
        value = Decimal(0)
    in_range = value.is_finite() and Decimal("1e-9") < value < Decimal("1e9")
    if not in_range or (key == "Frames:" and value % 1):
        fail(path, line, f"expected '{key}' and {what}, found {text[:60]!r}")
    return value


def _rate(path: Path, line: int, frame_time: Decimal) -> float:
    """Return frames per second; a printed frame time such as 0.0333333 means 30 Hz."""
    rate = 1.0 / float(frame_time)
    if not 0.1 <= rate <= 1e5:
        fail(path, line, f"expected a frame time between 0.00001 and 10 s, found {frame_time}")
    half_digit = 0.5 * 10.0 ** int(frame_time.as_tuple().exponent)
    whole = round(rate)
    return float(whole) if whole and abs(1.0 / whole - float(frame_time)) <= half_digit else rate


def bvh_text(skeleton: Skeleton, poses: FloatArray, rate_hz: float, unit: str = "cm") -> str:
    """Return the BVH file of poses (F, P), m and rad, at `rate_hz` frames per second; lengths in `unit`, "cm" or "m".

    A joint's channels are its angles in degrees, in the skeleton's order, with the sign of their axis: BVH too
    multiplies a joint's rotations outermost first. Angles are not converted, so they stay continuous and no pose is
    singular. A joint with fewer than three rotations gets zero channels, since readers expect three. A joint without
    children becomes the End Site of its parent, without a name. Raises ValueError for a joint with rotation axes other
    than different axes of its frame.
    """
    hierarchy, columns = _branch(skeleton, 0, PER_METRE[unit], depth=0)
    signs = skeleton.dof_axes.sum(axis=1)  # of axes ±x, ±y, ±z; +1 for positions
    scales = np.where(np.arange(len(signs)) < N_POSITION, PER_METRE[unit], np.rad2deg(1.0) * signs)
    padded = np.hstack([poses * scales, np.zeros((len(poses), 1))])  # column -1: a rotation that the joint lacks
    values = np.round(padded[:, columns], _DIGITS) + 0.0  # no "-0.000000"
    rows = [" ".join([f"{value:.{_DIGITS}f}" for value in row]) for row in values.tolist()]
    head = ["MOTION", f"Frames: {len(poses)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    return "\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""])


def _branch(skeleton: Skeleton, joint: int, scale: float, depth: int) -> tuple[list[str], list[int]]:
    """Return the lines of a joint and its descendants, and the pose's column of each of their channels (-1: none).

    A joint has at most one End Site: of several leaves, such as heel and toes, each is a joint with an End Site of its
    own.
    """
    tab = "\t" * depth
    children = np.flatnonzero(skeleton.parents == joint).tolist()
    is_end = not children and (skeleton.parents == skeleton.parents[joint]).sum() == 1
    kind = "End Site" if is_end else f"{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}"
    offset = np.round(skeleton.offsets[joint, FILE_FROM_WORLD] * scale, _DIGITS) + 0.0
    lines = [f"{tab}{kind}", f"{tab}{{", f"{tab}\tOFFSET {' '.join([f'{value:.{_DIGITS}f}' for value in offset])}"]
    columns: list[int] = []
    if not is_end:
        names, columns = _joint_channels(skeleton, joint)
        lines.append(f"{tab}\tCHANNELS {len(names)} {' '.join(names)}")
        if not children:
            lines += [f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET 0 0 0", f"{tab}\t}}"]
    for child in children:
        child_lines, child_columns = _branch(skeleton, child, scale, depth + 1)
        lines += child_lines
        columns += child_columns
    return [*lines, f"{tab}}}"], columns


def _joint_channels(skeleton: Skeleton, joint: int) -> tuple[list[str], list[int]]:
    """Return the names of a joint's channels, and the pose's column of each (-1: none)."""
    positions = dict.fromkeys(_POSITIONS, -1) if joint == 0 else {}
    rotations: dict[str, int] = {}
    for column in np.flatnonzero(skeleton.dof_joints == joint).tolist():
        axis = np.abs(skeleton.dof_axes[column])
        letter = "XYZ"[FILE_FROM_WORLD.index(int(np.argmax(axis)))]
        if column < N_POSITION:
            positions[f"{letter}position"] = column
        elif axis.max() == axis.sum() == 1.0 and f"{letter}rotation" not in rotations:
            rotations[f"{letter}rotation"] = column
        else:
            raise ValueError(f"{skeleton.names[joint]}: BVH supports one rotation about each of the x, y and z axes")
    missing = {f"{letter}rotation": -1 for letter in "XYZ" if f"{letter}rotation" not in rotations}
    channels = positions | rotations | missing
    return list(channels), list(channels.values())
