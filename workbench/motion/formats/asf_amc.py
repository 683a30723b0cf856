"""Acclaim files: an ASF skeleton and the AMC motions made with it, as in the CMU database."""

from dataclasses import dataclass, field
from itertools import permutations
from math import isclose
from pathlib import Path

import numpy as np
import scipy

from workbench.motion.clip import Clip, clip_of_file
from workbench.motion.formats.text import fail, numbers, read_lines, statements
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MOST_FRAMES, MOST_JOINTS

_INCH_M = 0.0254
_AXIS_ORDERS = tuple("".join(order) for order in permutations("XYZ"))
_TURNS = ("rx", "ry", "rz")
_SHIFTS = ("tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class AsfSkeleton:
    """The skeleton of an ASF file, in the file's axes (y up). A joint is the near end of its bone, and turns it.

    joints: K names, parents before children: the root, the bones, and <bone>_end for every bone without children.
    parents: (K,), -1 for the root. offsets: (K, 3), m, a joint's place seen from its parent's, at rest. axes:
    (K, 3, 3), rotation from the frame a joint's angles are given in. axis_orders: K words such as "XYZ", the order of
    the turns. channels: K tuples of "tx".."rz", what an AMC line gives of the joint and in which order (empty: it
    does not turn). metres_per_unit: the length of 1. degrees: whether the angles of motions are in degrees.
    """

    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    axes: FloatArray
    axis_orders: tuple[str, ...]
    channels: tuple[tuple[str, ...], ...]
    metres_per_unit: float
    degrees: bool


def read_asf(path: str | Path) -> AsfSkeleton:
    """The skeleton of an ASF file.

    Lengths are in units of 1/`length` inch (the CMU database: 1/0.45 inch), angles as `angle` says (deg or rad).
    Raises InputError, with the file and the line, when the file is missing, malformed or truncated, or uses what the
    CMU database does not: a root that starts displaced or turned, bones that stretch or shift.
    """
    path, section = Path(path), ""
    file, lines = _AsfFile(path), read_lines(path)
    for line, words in statements(lines):
        if words[0].startswith(":"):
            section = words[0].lower()
        elif section in _ASF_SECTIONS:
            _ASF_SECTIONS[section](file, line, words)
    if file.open_bone is not None or len(file.bones) < 2 or not file.children:
        fail(path, len(lines), "expected whole :bonedata and :hierarchy sections before the end of the file")
    return _skeleton(file, len(lines))


def read_amc(path: str | Path, asf: str | Path | None = None, rate_hz: float = 120.0) -> Clip:
    """The clip of an AMC file; `asf` is its skeleton's file, by default the one beside it named for the subject
    (35.asf for 35_02.amc). The format carries no rate; 120 Hz is that of the CMU database.

    Angles are in degrees or radians as the file says, else as the ASF says. Raises InputError, with the file and the
    line, for a missing, repeated or unknown bone, a wrong number of values, what is not a number, a truncated frame,
    frame numbers that do not follow each other, and a file without frames.
    """
    path = Path(path)
    if not 0.1 <= rate_hz <= 1e5:
        raise InputError(f"{path}: the rate must be between 0.1 and 100000 Hz, found {rate_hz}")
    lines = read_lines(path)
    skeleton = read_asf(path.with_name(f"{path.stem.rpartition('_')[0] or path.stem}.asf") if asf is None else asf)
    file = _read_frames(path, lines, skeleton)
    values = np.array(file.frames)

    rotations = np.broadcast_to(np.eye(3), (len(values), len(skeleton.joints), 3, 3)).copy()
    places = np.broadcast_to(skeleton.offsets, (len(values), *skeleton.offsets.shape)).copy()
    for k, (joint, channels) in enumerate(zip(skeleton.joints, skeleton.channels, strict=True)):
        if not channels:
            continue
        given = dict(zip(channels, values[:, file.columns[joint]].T, strict=True))
        # lower case is scipy's word for turns about fixed axes
        order = skeleton.axis_orders[k].lower()
        angles = np.stack([given.get(f"r{axis}", np.zeros(len(values))) for axis in order], axis=-1)
        turns = scipy.spatial.transform.Rotation.from_euler(order, angles, degrees=file.degrees).as_matrix()
        rotations[:, k] = skeleton.axes[k] @ turns @ skeleton.axes[k].T
        if k == 0:
            places[:, 0] = np.stack([given[shift] for shift in _SHIFTS], axis=-1) * skeleton.metres_per_unit
    joints, parents, offsets = skeleton.joints, skeleton.parents, skeleton.offsets
    return clip_of_file(path.stem, rate_hz, file.first, joints, parents, offsets, rotations, places)


@dataclass
class _AmcFile:
    """What is read so far: the angles' unit, the frames' values, and the bones the last frame still lacks."""

    path: Path
    columns: dict[str, slice]  # where each bone's values stand in a frame
    degrees: bool
    first: int = 0
    frames: list[list[float]] = field(default_factory=list)
    lacking: set[str] = field(default_factory=set)

    @property
    def number(self) -> int:
        """The last frame's number in the file."""
        return self.first + len(self.frames) - 1


def _read_frames(path: Path, lines: list[str], skeleton: AsfSkeleton) -> _AmcFile:
    columns, start = {}, 0
    for joint, channels in zip(skeleton.joints, skeleton.channels, strict=True):
        if channels:
            columns[joint] = slice(start, start + len(channels))
            start += len(channels)
    file = _AmcFile(path, columns, skeleton.degrees)
    for line, words in statements(lines):
        if words[0].startswith(":"):
            _amc_keyword(file, line, words)
        elif words[0].isdecimal() or not file.frames:
            _begin_frame(file, line, words)
        else:
            _add_bone(file, line, words)
    if not file.frames:
        fail(path, len(lines), "expected frames, found none")
    _check_whole_frame(file, len(lines))
    return file


def _amc_keyword(file: _AmcFile, line: int, words: list[str]) -> None:
    keyword = words[0].upper()
    if file.frames or len(words) > 1 or keyword not in (":DEGREES", ":RADIANS", ":FULLY-SPECIFIED"):
        expected = "a bone or a frame's number" if file.frames else ":DEGREES, :RADIANS or :FULLY-SPECIFIED"
        fail(file.path, line, f"expected {expected}, found {' '.join(words)[:60]!r}")
    if keyword != ":FULLY-SPECIFIED":
        file.degrees = keyword == ":DEGREES"


def _begin_frame(file: _AmcFile, line: int, words: list[str]) -> None:
    _check_whole_frame(file, line)
    found = int(words[0]) if len(words) == 1 and words[0].isdecimal() and len(words[0]) < 10 else None
    if found is None or (file.frames and found != file.number + 1):
        expected = f"the number {file.number + 1}" if file.frames else "the number"
        fail(file.path, line, f"expected {expected} of a frame, found {' '.join(words)[:60]!r}")
    if not file.frames:
        file.first = found
    if len(file.frames) == MOST_FRAMES:
        fail(file.path, line, f"expected at most {MOST_FRAMES} frames, found more")
    file.frames.append([0.0] * sum(own.stop - own.start for own in file.columns.values()))
    file.lacking = set(file.columns)


def _add_bone(file: _AmcFile, line: int, words: list[str]) -> None:
    bone = words[0]
    if bone not in file.columns:
        fail(file.path, line, f"expected a bone that turns in the skeleton, found {bone[:60]!r} in frame {file.number}")
    if bone not in file.lacking:
        fail(file.path, line, f"expected {bone} once in frame {file.number}, found it again")
    file.lacking.remove(bone)
    columns, what = file.columns[bone], f"{bone} in frame {file.number}"
    file.frames[-1][columns] = numbers(file.path, line, words[1:], columns.stop - columns.start, what)


def _check_whole_frame(file: _AmcFile, line: int) -> None:
    if file.lacking:
        lacking = ", ".join(bone for bone in file.columns if bone in file.lacking)
        fail(file.path, line, f"expected the rest of frame {file.number}, which lacks {lacking}")


@dataclass
class _Bone:
    """A bone as its lines are read; the root is one of no length."""

    name: str = ""
    direction: list[float] | None = None
    length: float | None = None
    axis: list[float] | None = None
    axis_order: str = "XYZ"
    channels: tuple[str, ...] = ()


@dataclass
class _AsfFile:
    """What is read so far; `open_bone` is the bone between its begin and its end."""

    path: Path
    length_unit: float = 1.0
    degrees: bool = True
    bones: dict[str, _Bone] = field(default_factory=lambda: {"root": _Bone("root", [0.0] * 3, 0.0, [0.0] * 3)})
    open_bone: _Bone | None = None
    children: dict[str, list[str]] = field(default_factory=dict)


def _unit(file: _AsfFile, line: int, words: list[str]) -> None:
    match words:
        case ["length", *length]:
            (file.length_unit,) = numbers(file.path, line, length, 1, "the unit of length")
            if file.length_unit <= 0.0:
                fail(file.path, line, f"expected a positive unit of length, found {file.length_unit}")
        case ["angle", "deg" | "rad" as unit]:
            file.degrees = unit == "deg"
        case ["angle", *found]:
            fail(file.path, line, f"expected the unit of angles, deg or rad, found {' '.join(found)!r}")


def _root(file: _AsfFile, line: int, words: list[str]) -> None:
    root = file.bones["root"]
    match words:
        case ["order", *channels]:
            root.channels = _channels(file, line, channels, (*_SHIFTS, *_TURNS))
            if len(root.channels) != 6:
                fail(file.path, line, f"expected TX TY TZ RX RY RZ in any order, found {' '.join(channels)!r}")
        case ["axis", order]:
            root.axis_order = _axis_order(file, line, order)
        case ["position" | "orientation" as what, *values]:
            if any(numbers(file.path, line, values, 3, f"the root's {what}")):
                fail(file.path, line, f"expected a root that starts with {what} 0 0 0, found {' '.join(values)!r}")
        case _:
            fail(file.path, line, f"expected order, axis, position or orientation, found {' '.join(words)[:60]!r}")


def _bone_data(file: _AsfFile, line: int, words: list[str]) -> None:
    bone = file.open_bone
    if bone is None:
        if words != ["begin"]:
            fail(file.path, line, f"expected the begin of a bone, found {' '.join(words)[:60]!r}")
        file.open_bone = _Bone()
        return
    match words:
        case ["end"]:
            _end_bone(file, line, bone)
        case ["begin"]:
            fail(file.path, line, f"expected the end of bone {bone.name!r} before the next begins")
        case ["name", name]:
            bone.name = name
        case ["direction", *values]:
            bone.direction = numbers(file.path, line, values, 3, f"the direction of {bone.name}")
        case ["length", *values]:
            (bone.length,) = numbers(file.path, line, values, 1, f"the length of {bone.name}")
        case ["axis", x, y, z, order]:
            bone.axis = numbers(file.path, line, (x, y, z), 3, f"the axis of {bone.name}")
            bone.axis_order = _axis_order(file, line, order)
        case ["dof", *channels]:
            bone.channels = _channels(file, line, channels, _TURNS)
        case ["id" | "limits" | "bodymass" | "cofmass", *_]:
            pass
        case [word, *_] if not word.startswith("("):  # limits go on for a line per degree of freedom
            fail(file.path, line, f"expected a property of bone {bone.name!r} or its end, found {word[:60]!r}")


def _end_bone(file: _AsfFile, line: int, bone: _Bone) -> None:
    if not bone.name or bone.name in file.bones:
        fail(file.path, line, f"expected a bone with a name of its own, found {bone.name!r}")
    if bone.direction is None or bone.axis is None or bone.length is None or bone.length < 0.0:
        fail(file.path, line, f"expected a direction, an axis and a length, not negative, of bone {bone.name}")
    size = float(np.linalg.norm(bone.direction))
    if not isclose(size, 1.0, abs_tol=1e-3):  # printed with six digits; one that is far off was meant otherwise
        fail(file.path, line, f"expected a direction of length 1 for bone {bone.name}, found one of length {size:.4g}")
    if len(file.bones) == MOST_JOINTS:
        fail(file.path, line, f"expected at most {MOST_JOINTS} bones, found more")
    file.bones[bone.name] = bone
    file.open_bone = None


def _hierarchy(file: _AsfFile, line: int, words: list[str]) -> None:
    if words in (["begin"], ["end"]):
        return
    if unknown := [name for name in words if name not in file.bones]:
        fail(file.path, line, f"expected bones of :bonedata, found {unknown[0][:60]!r}")
    taken = {"root"}.union(*file.children.values())
    if repeated := [name for n, name in enumerate(words[1:], 1) if name in taken or name in words[:n]]:
        fail(file.path, line, f"expected one parent of {repeated[0]}, found a second one, {words[0]}")
    file.children.setdefault(words[0], []).extend(words[1:])


_ASF_SECTIONS = {":units": _unit, ":root": _root, ":bonedata": _bone_data, ":hierarchy": _hierarchy}


def _channels(file: _AsfFile, line: int, words: list[str], allowed: tuple[str, ...]) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words)
    if not channels or not set(channels) <= set(allowed) or len(set(channels)) < len(channels):
        fail(file.path, line, f"expected some of {' '.join(allowed)}, each once, found {' '.join(words)[:60]!r}")
    return channels


def _axis_order(file: _AsfFile, line: int, word: str) -> str:
    if word.upper() not in _AXIS_ORDERS:
        fail(file.path, line, f"expected an order of axes such as XYZ, found {word[:60]!r}")
    return word.upper()


def _skeleton(file: _AsfFile, last_line: int) -> AsfSkeleton:
    """The joints in the order of the hierarchy, depth first."""
    metres = _INCH_M / file.length_unit
    ends = {name: metres * (b.length or 0.0) * np.array(b.direction) for name, b in file.bones.items()}
    joints: list[str] = []
    parents: list[int] = []
    waiting = [("root", -1)]
    while waiting:
        name, parent = waiting.pop()
        children = file.children.get(name, [] if name not in file.bones else [f"{name}_end"])
        waiting += [(child, len(joints)) for child in reversed(children)]
        joints.append(name)
        parents.append(parent)
    if loose := set(file.bones) - set(joints):
        fail(file.path, last_line, f"expected {sorted(loose)[0]} to hang from the root in :hierarchy")
    bones = [file.bones.get(name, _Bone(name)) for name in joints]
    axes = [_axis_rotation(bone, file.degrees) for bone in bones]
    if not bones[0].channels:
        fail(file.path, last_line, "expected the order of the root's channels in :root")
    return AsfSkeleton(
        joints=tuple(joints), parents=np.array(parents),
        offsets=np.array([ends[joints[parent]] if parent >= 0 else np.zeros(3) for parent in parents]),
        axes=np.array(axes), axis_orders=tuple(bone.axis_order for bone in bones),
        channels=tuple(bone.channels for bone in bones), metres_per_unit=metres, degrees=file.degrees,
    )  # fmt: skip


def _axis_rotation(bone: _Bone, degrees: bool) -> FloatArray:
    given = bone.axis or [0.0, 0.0, 0.0]  # the ends have none
    angles = [given["XYZ".index(axis)] for axis in bone.axis_order]
    return scipy.spatial.transform.Rotation.from_euler(bone.axis_order.lower(), angles, degrees=degrees).as_matrix()
