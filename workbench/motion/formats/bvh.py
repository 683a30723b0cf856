"""BVH files: a hierarchy of joints, then one line of channel values per frame.

BVH has no specification; the output follows Biovision's files and is readable by this reader and by Blender.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
import scipy

from workbench.body.skeleton import Skeleton
from workbench.motion.clip import FILE_FROM_WORLD, MotionClip, clip_of_file
from workbench.motion.formats.text import Statement, fail, numbers, read_lines
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_FRAMES, MAX_JOINTS, check_number

_METRES = {"cm": 0.01, "m": 1.0}
PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
_POSITIONS = ("Xposition", "Yposition", "Zposition")
_ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
_DIGITS = 6  # a millionth of a degree moves a hand by 10 nm
_N_POSITIONS = 3


@dataclass
class _Joint:
    name: str
    parent: int
    is_end: bool
    offset: list[float] | None = None
    channels: tuple[str, ...] = ()


def read_bvh(path: str | Path, unit: str = "cm") -> MotionClip:
    """Return the clip of a BVH file with lengths in `unit`, "cm" or "m"; frames count from 1.

    A joint has 3 rotation channels, or 6 with positions, in any order; its rotation is intrinsic, in the order of its
    channels. Positions replace the joint's offset (of the root too, whose offset is zero in most files). End sites
    become joints <parent>_end. A frame time that equals 1/N s to its printed digits means N Hz. Raises InputError, with
    the file and the line, for other content, a truncated file, and an unknown unit.
    """
    path = Path(path)
    if unit not in _METRES:
        raise InputError(f"{path}: the unit of a BVH file must be one of {', '.join(_METRES)}, found {unit!r}")
    lines = read_lines(path)
    joints, line = _read_hierarchy(path, lines)
    rate_hz, values = _read_motion(path, lines, line, sum(len(joint.channels) for joint in joints))

    offsets = np.array([joint.offset for joint in joints]) * _METRES[unit]
    translations = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    rotations = np.broadcast_to(np.eye(3), (*translations.shape, 3)).copy()
    column = 0
    for k, joint in enumerate(joints):
        channels = dict(zip(joint.channels, values[:, column : column + len(joint.channels)].T, strict=True))
        column += len(joint.channels)
        if rotation_channels := [name for name in joint.channels if name in _ROTATIONS]:
            order = "".join(name[0] for name in rotation_channels)  # upper case means intrinsic in scipy
            angles = np.stack([channels[name] for name in rotation_channels], axis=-1)
            rotations[:, k] = scipy.spatial.transform.Rotation.from_euler(order, angles, degrees=True).as_matrix()
        if len(channels) == 6:
            translations[:, k] = np.stack([channels[name] for name in _POSITIONS], axis=-1) * _METRES[unit]
    parents = np.array([joint.parent for joint in joints])
    names = tuple(joint.name for joint in joints)
    return clip_of_file(path.stem, rate_hz, 1, names, parents, offsets, rotations, translations)


def _read_hierarchy(path: Path, lines: list[str]) -> tuple[list[_Joint], int]:
    """Return the joints, and the index of the line after MOTION."""
    if lines[0].split() != ["HIERARCHY"]:
        fail(path, 1, f"expected HIERARCHY, found {lines[0].strip()[:60]!r}")
    joints: list[_Joint] = []
    branch: list[int] = []  # joints with open braces
    is_new = False  # the last joint has no opening brace yet
    for line, words in _statements(lines):
        joint, found = joints[branch[-1]] if branch else None, repr(" ".join(words)[:60])
        if is_new != (words == ["{"]):
            fail(path, line, f"expected {'{' if is_new else 'a statement'}, found {found}")
        match words:
            case ["MOTION"]:
                if branch or not joints:
                    fail(path, line, "expected a ROOT, and the closing brace of every joint, before MOTION")
                return joints, line
            case ["{"]:
                branch.append(len(joints) - 1)
                is_new = False
            case ["ROOT" | "JOINT" | "End" as kind, *name] if joint is None or not joint.is_end:
                if (kind == "ROOT") == bool(joints) or (joint is None) != (kind == "ROOT"):
                    fail(path, line, f"expected one ROOT, and joints between its braces, found {found}")
                joints.append(_new_joint(path, line, joints, kind, " ".join(name), branch[-1] if branch else -1))
                is_new = True
            case ["OFFSET", *offset] if joint:
                joint.offset = numbers(path, line, offset, 3, f"the offset of {joint.name}")
            case ["CHANNELS", *channels] if joint and not joint.is_end:
                joint.channels = _channels(path, line, channels, joint.name)
            case ["}"] if joint:
                if joint.offset is None or not (joint.channels or joint.is_end):
                    fail(path, line, f"expected the OFFSET and CHANNELS of {joint.name} before its end")
                branch.pop()
            case _:
                fail(path, line, f"expected a statement of the hierarchy here, found {found}")
    fail(path, len(lines), "expected MOTION, found the end of the file")


def _statements(lines: list[str]) -> Iterator[Statement]:
    """Yield the number and words of the lines after the first; a brace at the end of a joint's line is separate."""
    for line, text in enumerate(lines[1:], 2):
        words = text.split()
        if len(words) > 1 and words[-1] == "{":
            yield line, words[:-1]
            words = ["{"]
        if words:
            yield line, words


def _new_joint(path: Path, line: int, joints: list[_Joint], kind: str, name: str, parent: int) -> _Joint:
    if kind == "End":
        name = f"{joints[parent].name}_end" if name.lower() == "site" else ""
    if not name or any(joint.name == name for joint in joints):
        fail(path, line, f"expected a new joint's name, found {name!r}")
    check_number(path, "joints", len(joints) + 1, MAX_JOINTS)
    return _Joint(name, parent, kind == "End")


def _channels(path: Path, line: int, words: list[str], joint: str) -> tuple[str, ...]:
    """Return the names of a joint's channels; words : their number, then the names."""
    names = tuple(words[1:])
    if words[:1] != [str(len(names))] or sorted(names) not in (sorted(_ROTATIONS), sorted(_POSITIONS + _ROTATIONS)):
        found = " ".join(words)[:80]
        fail(path, line, f"expected 3 rotations, or 3 positions and 3 rotations, for {joint}, found {found!r}")
    return names


def _read_motion(path: Path, lines: list[str], start: int, n_channels: int) -> tuple[float, FloatArray]:
    """Return the rate, Hz, and the channel values (F, n_channels) of the lines after MOTION."""
    n_frames = int(_header(path, lines, start, "Frames:", "a whole number of frames"))
    rate_hz = _rate(path, start + 2, _header(path, lines, start + 1, "Frame Time:", "seconds a frame"))
    rows = lines[start + 2 :]
    while rows and not rows[-1].strip():
        rows.pop()
    if len(rows) != n_frames:
        fail(path, start + 2 + len(rows), f"expected {n_frames} lines of frames after the header, found {len(rows)}")
    check_number(path, "frames", n_frames, MAX_FRAMES)
    values = [numbers(path, start + 3 + k, row.split(), n_channels, f"frame {k + 1}") for k, row in enumerate(rows)]
    return rate_hz, np.array(values)


def _header(path: Path, lines: list[str], index: int, key: str, what: str) -> Decimal:
    """Return the number after `key`, above 0 and below 1e9, with its printed digits; whole where `key` is Frames."""
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
    children becomes the End Site of its parent, without a name. Raises ValueError for another unit, or a joint with
    rotation axes other than different axes of its frame.
    """
    if unit not in ("cm", "m"):
        raise ValueError(f"the unit of a BVH file must be cm or m, found {unit!r}")
    hierarchy, columns = _branch(skeleton, 0, PER_METRE[unit], depth=0)
    signs = skeleton.dof_axes.sum(axis=1)  # of axes ±x, ±y, ±z; +1 for positions
    scales = np.where(np.arange(len(signs)) < _N_POSITIONS, PER_METRE[unit], np.rad2deg(1.0) * signs)
    padded = np.hstack([poses * scales, np.zeros((len(poses), 1))])  # column -1: a rotation that the joint lacks
    values = np.round(padded[:, columns], _DIGITS) + 0.0  # no "-0.000000"
    rows = [" ".join([f"{value:.{_DIGITS}f}" for value in row]) for row in values.tolist()]
    head = ["MOTION", f"Frames: {len(poses)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    return "\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""])


def _branch(skeleton: Skeleton, joint: int, scale: float, depth: int) -> tuple[list[str], list[int]]:
    """Return the lines of a joint and its descendants, and the pose's column of each of their channels (-1: none)."""
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
        if column < _N_POSITIONS:
            positions[f"{letter}position"] = column
        elif axis.max() == axis.sum() == 1.0 and f"{letter}rotation" not in rotations:
            rotations[f"{letter}rotation"] = column
        else:
            raise ValueError(f"{skeleton.names[joint]}: BVH supports one rotation about each of the x, y and z axes")
    missing = {f"{letter}rotation": -1 for letter in "XYZ" if f"{letter}rotation" not in rotations}
    channels = positions | rotations | missing
    return list(channels), list(channels.values())
