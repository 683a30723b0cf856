"""BVH files: a hierarchy of joints, then one line of channel values a frame."""

from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.arrays import FloatArray
from workbench.errors import InputError
from workbench.mocap.clip import Clip, clip_of_file
from workbench.mocap.text import fail, numbers, read_lines

_METRES = {"cm": 0.01, "m": 1.0}
_POSITIONS = ("Xposition", "Yposition", "Zposition")
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
            rotations[:, k] = Rotation.from_euler(order, angles, degrees=True).as_matrix()
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
