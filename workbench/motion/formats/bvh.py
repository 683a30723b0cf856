"""BVH files: a hierarchy of joints, then one line of channel values a frame.

BVH has no specification; what is written is what Biovision's files look like and what the reader here and Blender read.
"""

from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
import scipy

from workbench.body.skeleton import Skeleton
from workbench.motion.clip import FILE_FROM_WORLD, Clip, clip_of_file
from workbench.motion.formats.text import fail, numbers, read_lines
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MOST_FRAMES, MOST_JOINTS

_METRES = {"cm": 0.01, "m": 1.0}
PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
_POSITIONS = ("Xposition", "Yposition", "Zposition")
_DIGITS = 6  # a millionth of a degree moves a hand by 10 nm
_N_POSITIONS = 3
_ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")


@dataclass
class _Joint:
    name: str
    parent: int
    is_end: bool
    offset: list[float] | None = None
    channels: tuple[str, ...] = ()


@dataclass
class _Hierarchy:
    """The joints read so far, the open braces' joints, and the joint that waits for its brace."""

    joints: list[_Joint] = field(default_factory=list)
    open: list[int] = field(default_factory=list)
    waiting: bool = False


def read_bvh(path: str | Path, unit: str = "cm") -> Clip:
    """The clip of a BVH file whose lengths are in `unit`, "cm" or "m"; frames count from 1.

    A joint has 3 rotation channels, or 6 with positions, in any order; its rotation is intrinsic, in the order of its
    channels. Positions replace the joint's offset (of the root too: most files have its offset zero). End sites
    become joints called <parent>_end. A frame time that is 1/N s to the digits it is printed with means N Hz.
    Raises InputError, with the file and the line, for anything else, for truncated files, and for an unknown unit.
    """
    path = Path(path)
    if unit not in _METRES:
        raise InputError(f"{path}: the unit of a BVH file must be one of {', '.join(_METRES)}, found {unit!r}")
    lines = read_lines(path)
    joints, line = _read_hierarchy(path, lines)
    rate_hz, values = _read_motion(path, lines, line, sum(len(joint.channels) for joint in joints))

    offsets = np.array([joint.offset for joint in joints]) * _METRES[unit]
    places = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    rotations = np.broadcast_to(np.eye(3), (*places.shape, 3)).copy()
    column = 0
    for k, joint in enumerate(joints):
        channels = dict(zip(joint.channels, values[:, column : column + len(joint.channels)].T, strict=True))
        column += len(joint.channels)
        if turns := [name for name in joint.channels if name in _ROTATIONS]:
            order = "".join(name[0] for name in turns)  # upper case is scipy's word for intrinsic
            angles = np.stack([channels[name] for name in turns], axis=-1)
            rotations[:, k] = scipy.spatial.transform.Rotation.from_euler(order, angles, degrees=True).as_matrix()
        if len(channels) == 6:
            places[:, k] = np.stack([channels[name] for name in _POSITIONS], axis=-1) * _METRES[unit]
    parents = np.array([joint.parent for joint in joints])
    names = tuple(joint.name for joint in joints)
    return clip_of_file(path.stem, rate_hz, 1, names, parents, offsets, rotations, places)


def _read_hierarchy(path: Path, lines: list[str]) -> tuple[list[_Joint], int]:
    """The joints, and the index of the line after MOTION."""
    if lines[0].split() != ["HIERARCHY"]:
        fail(path, 1, f"expected HIERARCHY, found {lines[0].strip()[:60]!r}")
    tree = _Hierarchy()
    for index in range(1, len(lines)):
        words = lines[index].split()
        if words == ["MOTION"]:
            if not tree.joints:
                fail(path, index + 1, "expected a ROOT before MOTION")
            if tree.open or tree.waiting:
                unclosed = tree.joints[-1].name
                fail(path, index + 1, f"expected the closing brace of {unclosed} or its parents before MOTION")
            return tree.joints, index + 1
        if len(words) > 1 and words[-1] == "{":  # the brace may share its joint's line
            _read_statement(path, index + 1, words[:-1], tree)
            words = ["{"]
        if words:
            _read_statement(path, index + 1, words, tree)
    fail(path, len(lines), "expected MOTION, found the end of the file")


def _read_statement(path: Path, line: int, words: list[str], tree: _Hierarchy) -> None:
    if tree.waiting != (words == ["{"]):
        fail(path, line, f"expected {'{' if tree.waiting else 'a statement'}, found {' '.join(words)[:60]!r}")
    joint = tree.joints[tree.open[-1]] if tree.open else None
    match words:
        case ["{"]:
            tree.open.append(len(tree.joints) - 1)
            tree.waiting = False
        case ["ROOT", *name] if not tree.joints:
            _add_joint(path, line, " ".join(name), tree)
        case ["JOINT", *name] if joint and not joint.is_end:
            _add_joint(path, line, " ".join(name), tree)
        case ["End", "Site" | "site"] if joint and not joint.is_end:
            _add_joint(path, line, f"{joint.name}_end", tree, is_end=True)
        case ["OFFSET", *offset] if joint:
            joint.offset = numbers(path, line, offset, 3, f"the offset of {joint.name}")
        case ["CHANNELS", *channels] if joint and not joint.is_end:
            joint.channels = _channels(path, line, channels, joint.name)
        case ["}"] if joint:
            if joint.offset is None or not (joint.channels or joint.is_end):
                fail(path, line, f"expected the OFFSET and CHANNELS of {joint.name} before its end")
            tree.open.pop()
        case _:
            fail(path, line, f"expected a statement of the hierarchy here, found {' '.join(words)[:60]!r}")


def _add_joint(path: Path, line: int, name: str, tree: _Hierarchy, is_end: bool = False) -> None:
    if not name or any(joint.name == name for joint in tree.joints):
        fail(path, line, f"expected a new joint's name, found {name!r}")
    if len(tree.joints) == MOST_JOINTS:
        fail(path, line, f"expected at most {MOST_JOINTS} joints, found more")
    tree.joints.append(_Joint(name, tree.open[-1] if tree.open else -1, is_end))
    tree.waiting = True


def _channels(path: Path, line: int, words: list[str], joint: str) -> tuple[str, ...]:
    """The names of a joint's channels; words: their number, then the names."""
    names = tuple(words[1:])
    if words[:1] != [str(len(names))] or sorted(names) not in (sorted(_ROTATIONS), sorted(_POSITIONS + _ROTATIONS)):
        found = " ".join(words)[:80]
        fail(path, line, f"expected 3 rotations, or 3 positions and 3 rotations, for {joint}, found {found!r}")
    return names


def _read_motion(path: Path, lines: list[str], start: int, n_channels: int) -> tuple[float, FloatArray]:
    """The rate, Hz, and the channel values, (F, n_channels), from the lines after MOTION."""
    n_frames = int(_header(path, lines, start, "Frames:", "a whole number of frames"))
    rate_hz = _rate(path, start + 2, _header(path, lines, start + 1, "Frame Time:", "seconds a frame"))
    rows = lines[start + 2 :]
    while rows and not rows[-1].strip():
        rows.pop()
    if len(rows) != n_frames:
        fail(path, start + 2 + len(rows), f"expected {n_frames} lines of frames after the header, found {len(rows)}")
    if n_frames > MOST_FRAMES:
        fail(path, start + 1, f"expected at most {MOST_FRAMES} frames, found {n_frames}")
    values = np.empty((n_frames, n_channels))
    for frame, row in enumerate(rows):
        values[frame] = numbers(path, start + 3 + frame, row.split(), n_channels, f"frame {frame + 1}")
    return rate_hz, values


def _header(path: Path, lines: list[str], index: int, key: str, what: str) -> Decimal:
    """The number after `key`, positive and below 1e9, with its printed digits; a whole one where `key` is Frames."""
    text = " ".join(lines[index].split()) if index < len(lines) else "the end of the file"
    try:
        value = Decimal(text.removeprefix(key).strip())
    except InvalidOperation:
        value = Decimal(0)
    in_range = value.is_finite() and Decimal("1e-9") < value < Decimal("1e9")
    if not text.startswith(key) or not in_range or (key == "Frames:" and value % 1):
        fail(path, index + 1, f"expected '{key}' and {what}, found {text[:60]!r}")
    return value


def _rate(path: Path, line: int, frame_time: Decimal) -> float:
    """Frames per second: 0.0333333 is how 30 Hz is printed."""
    rate = 1.0 / float(frame_time)
    if not 0.1 <= rate <= 1e5:
        fail(path, line, f"expected a frame time between 0.00001 and 10 s, found {frame_time}")
    half_digit = 0.5 * 10.0 ** int(frame_time.as_tuple().exponent)
    whole = round(rate)
    return float(whole) if whole and abs(1.0 / whole - float(frame_time)) <= half_digit else rate


def bvh_text(skeleton: Skeleton, poses: FloatArray, rate_hz: float, unit: str = "cm") -> str:
    """The BVH file of poses (F, P), m and rad, at `rate_hz` frames per second; lengths in `unit`, "cm" or "m".

    A joint's channels are its own angles in degrees, in the skeleton's order, with the sign of their axis: BVH too
    multiplies a joint's turns outermost first. Nothing is converted, so angles stay continuous and no pose is
    singular. Where a joint has fewer than three turns the others are zero, since readers expect three. A joint without
    children becomes the End Site of its parent, which has no name.
    Raises ValueError for another unit and for a joint that turns about anything but three different axes of its frame.
    """
    if unit not in ("cm", "m"):
        raise ValueError(f"the unit of a BVH file must be cm or m, found {unit!r}")
    hierarchy, columns = _branch(skeleton, 0, PER_METRE[unit], depth=0)
    signs = skeleton.dof_axes.sum(axis=1)  # of axes ±x, ±y, ±z; the positions' are +1
    scales = np.where(np.arange(len(signs)) < _N_POSITIONS, PER_METRE[unit], np.rad2deg(1.0) * signs)
    padded = np.hstack([poses * scales, np.zeros((len(poses), 1))])  # column -1: a turn the joint does not have
    values = np.round(padded[:, columns], _DIGITS) + 0.0  # no "-0.000000"
    rows = [" ".join([f"{value:.{_DIGITS}f}" for value in row]) for row in values.tolist()]
    head = ["MOTION", f"Frames: {len(poses)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    return "\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""])


def _branch(skeleton: Skeleton, joint: int, scale: float, depth: int) -> tuple[list[str], list[int]]:
    """The lines of a joint and what hangs on it, and the pose's column for each of their channels (-1: none)."""
    tab = "\t" * depth
    children = np.flatnonzero(skeleton.parents == joint).tolist()
    kind = f"{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}" if children else "End Site"
    offset = np.round(skeleton.offsets[joint, FILE_FROM_WORLD] * scale, _DIGITS) + 0.0
    lines = [f"{tab}{kind}", f"{tab}{{", f"{tab}\tOFFSET {' '.join([f'{value:.{_DIGITS}f}' for value in offset])}"]
    columns: list[int] = []
    if children:
        names, columns = _joint_channels(skeleton, joint)
        lines.append(f"{tab}\tCHANNELS {len(names)} {' '.join(names)}")
    for child in children:
        below, more = _branch(skeleton, child, scale, depth + 1)
        lines += below
        columns += more
    return [*lines, f"{tab}}}"], columns


def _joint_channels(skeleton: Skeleton, joint: int) -> tuple[list[str], list[int]]:
    """Names of a joint's channels, and the pose's column for each (-1: none)."""
    positions = dict.fromkeys(("Xposition", "Yposition", "Zposition"), -1) if joint == 0 else {}
    turns: dict[str, int] = {}
    for column in np.flatnonzero(skeleton.dof_joints == joint).tolist():
        axis = np.abs(skeleton.dof_axes[column])
        letter = "XYZ"[FILE_FROM_WORLD.index(int(np.argmax(axis)))]
        if column < _N_POSITIONS:
            positions[f"{letter}position"] = column
        elif axis.max() == axis.sum() == 1.0 and f"{letter}rotation" not in turns:
            turns[f"{letter}rotation"] = column
        else:
            raise ValueError(f"{skeleton.names[joint]}: BVH turns a joint about its x, y and z axes, once each")
    missing = {f"{letter}rotation": -1 for letter in "XYZ" if f"{letter}rotation" not in turns}
    channels = positions | turns | missing
    return list(channels), list(channels.values())
