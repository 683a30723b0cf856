"""Acclaim files: an ASF skeleton and its AMC motions, as in the CMU database."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import permutations
from math import isclose
from pathlib import Path

import numpy as np
import scipy

from workbench.body.units import UNITS
from workbench.motion.clip import MotionClip
from workbench.motion.formats.person_clip import person_clip
from workbench.motion.formats.text import (
    Statement,
    fail,
    gap_numbers,
    last_values,
    numbers,
    points,
    read_lines,
    statements,
)  # fmt: skip
from workbench.utils import input_limits
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_FRAMES, MAX_JOINTS, check_number, check_rate

log = logging.getLogger(__name__)

CMU_HZ = 120.0
_MAX_AMC = 50_000_000
"""Bytes of a file, whose words and rotations take 37 times as much memory: 7 minutes at 120 Hz."""
_AXIS_ORDERS = tuple("".join(order) for order in permutations("XYZ"))
_ROTATIONS = ("rx", "ry", "rz")
_TRANSLATIONS = ("tx", "ty", "tz")
_PROPERTIES = frozenset(["end", "id", "name", "direction", "length", "axis", "dof", "limits", "bodymass", "cofmass"])

_Properties = dict[str, tuple[int, list[str]]]
"""Line and values by keyword."""


@dataclass(frozen=True, eq=False)
class _Bone:
    """A bone from its joint to `end` (3,), in the file's unit.

    axis : rotation (3, 3) from the frame of its angles. order : of the rotations, e.g. "XYZ". channels : the values in
    an AMC line, of "tx".."rz" and "l"; none if the joint is rigid.
    """

    end: FloatArray
    axis: FloatArray
    order: str = "XYZ"
    channels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _AsfSkeleton:
    """The skeleton of an ASF file, in the file's axes (y up). A joint is the proximal end of its bone.

    joints : K names, parents before children: the root, the bones, and <bone>_end for every bone without children.
    parents : (K,), -1 for the root. bones : K. unit : in metres; "" if the file has none. degrees : whether angles are
    in degrees. position : of the root (3,) in every frame, to which its translation is added.
    """

    joints: tuple[str, ...]
    parents: IntArray
    bones: tuple[_Bone, ...]
    unit: float | str
    degrees: bool
    position: FloatArray


def _read_asf(path: str | Path) -> _AsfSkeleton:
    """Return the skeleton of an ASF file.

    The unit is 1/`length` inch (the CMU database: 1/0.45 inch), angles are in `angle`, deg or rad. Raises InputError,
    with the file and the line, if the file is missing, malformed or truncated, or uses features that the CMU database
    does not: a root with an initial rotation, bones that translate.
    """
    path = Path(path)
    lines = read_lines(path)
    sections: dict[str, list[Statement]] = {}
    section = sections.setdefault("", [])
    for line, words in statements(lines):
        if words[0].startswith(":"):
            section = sections.setdefault(words[0].lower(), [])
        else:
            section.append((line, words))
    blocks = _blocks(path, sections.get(":bonedata", ()), len(lines))
    unit, degrees = _units(path, _properties(sections.get(":units", ())))
    root, position = _root(path, _properties(sections.get(":root", ())), len(lines))
    bones = {"root": root}
    for block in blocks:
        line, name = block["end"][0], " ".join(block.get("name", (0, []))[1])
        if not name or name in bones:
            fail(path, line, f"expected a bone with a unique name, found {name!r}")
        bones[name] = _bone(path, name, block, degrees)
    check_number(path, "bones", len(bones), MAX_JOINTS)
    joints, parents = _tree(path, sections.get(":hierarchy", ()), bones, len(lines))
    end = _Bone(np.zeros(3), np.eye(3))
    return _AsfSkeleton(
        joints, np.array(parents), tuple(bones.get(name, end) for name in joints), unit, degrees, position
    )


def read_amc(
    path: str | Path, asf: str | Path | None = None, rate_hz: float | None = None, unit: str | None = None,
    up: str | None = None,
) -> MotionClip:  # fmt: skip
    """Return the clip of an AMC file.

    Parameters
    ----------
    path : the file. Its angles are in degrees or radians as the file states, else as the ASF states.
    asf : the skeleton's file, by default one in the same folder: with the longest name with which the motion's begins
        (35.asf for 35_02.amc), or the only one.
    rate_hz : Hz, of the frame numbers; None: the file's :SAMPLES-PER-SECOND, else 120 Hz as in the CMU database.
    unit : of length, one of `units.UNITS`; None: the ASF's, if the person then has a plausible size.
    up : the vertical axis; None: y, unless the person then is not upright, see `units_axes.vertical_axis`.

    Raises
    ------
    InputError : with the file and the line, for a repeated or unknown bone, a wrong number of values, a value that is
        not a number, frame numbers that do not increase, and a file without frames.
    """
    path = Path(path)
    lines = read_lines(path, _MAX_AMC)
    skeleton = _read_asf(_skeleton_file(path) if asf is None else asf)
    channels = {joint: bone.channels for joint, bone in zip(skeleton.joints, skeleton.bones, strict=True)}
    rows, degrees = list(statements(lines)), skeleton.degrees
    n_keywords = next((k for k, (_, words) in enumerate(rows) if not words[0].startswith(":")), len(rows))
    for line, words in rows[:n_keywords]:
        match [words[0].upper(), *words[1:]]:
            case [":DEGREES" | ":RADIANS" as keyword]:
                degrees = keyword == ":DEGREES"
            case [":SAMPLES-PER-SECOND", *rate]:
                (file_hz,) = numbers(path, line, rate, 1, "samples per second")
                rate_hz = file_hz if rate_hz is None else rate_hz
            case [":FULLY-SPECIFIED"]:
                pass
            case _:
                fail(path, line, f"expected :DEGREES, :RADIANS or :FULLY-SPECIFIED, found {' '.join(words)[:60]!r}")
    if rate_hz is None:
        log.warning("%s: an AMC file has no rate; read at %g Hz, that of the CMU database (rate_hz)", path, CMU_HZ)
    sizes = {joint: n for joint, each in channels.items() if (n := len(each))}
    step, frames = _regular(path, _frames(path, rows[n_keywords:], sizes))
    rate_hz = check_rate(f"{path}: the rate", CMU_HZ if rate_hz is None else rate_hz) / step
    values = np.array([[value for bone in sizes for value in frame[bone]] for frame in frames])
    return _clip(path, skeleton, rate_hz, last_values(path, values), degrees, unit, up)


def _clip(
    path: Path, skeleton: _AsfSkeleton, rate_hz: float, values: FloatArray, degrees: bool, unit: str | None,
    up: str | None,
) -> MotionClip:  # fmt: skip
    """Return the clip of the channels' values (F, C), bone after bone."""
    n, column = len(values), 0
    offsets = np.array([skeleton.bones[parent].end if parent >= 0 else np.zeros(3) for parent in skeleton.parents])
    rotations = np.broadcast_to(np.eye(3), (n, len(skeleton.joints), 3, 3)).copy()
    translations = np.broadcast_to(offsets, (n, *offsets.shape)).copy()
    for k, bone in enumerate(skeleton.bones):
        if bone.channels:
            channels = dict(zip(bone.channels, values[:, column : column + len(bone.channels)].T, strict=True))
            column += len(bone.channels)
            if "l" in channels and (channels["l"] != 0.0).any():
                raise InputError(f"{path}: expected bones of constant length, found {skeleton.joints[k]} stretched")
            angles = np.stack([channels.get(f"r{axis}", np.zeros(n)) for axis in bone.order.lower()], axis=-1)
            rotations[:, k] = bone.axis @ _rotation_matrices(bone.order, angles, degrees) @ bone.axis.T
            if k == 0:
                displaced = np.stack([channels[channel] for channel in _TRANSLATIONS], axis=-1)
                translations[:, 0] = skeleton.position + displaced
    return person_clip(
        path, rate_hz, skeleton.joints, skeleton.parents, offsets, rotations, translations, skeleton.unit, unit, up
    )


def _skeleton_file(path: Path) -> Path:
    """Return the skeleton's file of a motion in its folder; raises InputError for none or several."""
    files = sorted(file for file in path.parent.iterdir() if file.suffix.lower() == ".asf" and file.name[0] != ".")
    named = [file for file in files if path.stem.lower().startswith(file.stem.lower())]
    if not named and len(files) != 1:
        missing = path.with_name(f"{path.stem.rpartition('_')[0] or path.stem}.asf")
        found = f", found {', '.join(file.name for file in files[:5])}; give the skeleton (--asf)" if files else ""
        raise InputError(f"{missing}: no such file{found}")
    chosen = max(named, key=lambda file: len(file.stem)) if named else files[0]
    if not named:
        log.warning("%s: its skeleton is taken to be that of %s, the only one in its folder", path, chosen.name)
    return chosen


def _frames(path: Path, rows: Iterable[Statement], sizes: dict[str, int]) -> dict[int, dict[str, list[float]]]:
    """Return the values by bone by frame number; NaN for a missing bone. sizes : number of values by bone."""
    frames: dict[int, dict[str, list[float]]] = {}
    number = -1
    for line, words in rows:
        if words[0].isdecimal() or not frames:
            index = int(words[0]) if len(words) == 1 and words[0].isdecimal() and len(words[0]) < 10 else None
            if index is None or index <= number:
                expected = f"a number above {number}" if frames else "the number"
                fail(path, line, f"expected {expected} of a frame, found {' '.join(words)[:60]!r}")
            number, frames[index] = index, {}
            check_number(path, "frames", len(frames), MAX_FRAMES)
            continue
        bone = words[0]
        if bone not in sizes:
            fail(path, line, f"expected a bone with channels in the skeleton, found {bone[:60]!r} in frame {number}")
        if bone in frames[number]:
            fail(path, line, f"expected {bone} once in frame {number}, found it again")
        frames[number][bone] = gap_numbers(path, line, points(words[1:]), sizes[bone], f"{bone} in frame {number}")
    check_number(path, "values", len(frames) * sum(sizes.values()), input_limits.MAX_VALUES)
    if absent := {bone for frame in frames.values() for bone in sizes if bone not in frame}:
        log.warning("%s: some frames lack %s", path, ", ".join(bone for bone in sizes if bone in absent))
    return {
        number: {bone: frame.get(bone, [np.nan] * n) for bone, n in sizes.items()} for number, frame in frames.items()
    }


def _regular(path: Path, frames: dict[int, dict[str, list[float]]]) -> tuple[int, list[dict[str, list[float]]]]:
    """Return the usual step between the frames' numbers, and the frames at this step; those that are missing have NaN.
    Raises InputError for no frames."""
    if not frames:
        fail(path, 1, "expected frames, found none")
    numbers_ = np.array(list(frames))
    step = int(np.gcd.reduce(np.diff(numbers_))) if len(frames) > 1 else 1
    if step > 1:
        log.warning("%s: the frame numbers increase by %d; the rate is that of the numbers over %d", path, step, step)
    wanted = range(int(numbers_[0]), int(numbers_[-1]) + 1, step)
    check_number(path, "frames", len(wanted), MAX_FRAMES)
    empty = {bone: [np.nan] * len(values) for bone, values in frames[int(numbers_[0])].items()}
    check_number(path, "values", len(wanted) * sum(map(len, empty.values())), input_limits.MAX_VALUES)
    return step, [frames.get(number, empty) for number in wanted]


def _properties(section: Iterable[Statement]) -> _Properties:
    return {keyword.lower(): (line, values) for line, (keyword, *values) in section}


def _blocks(path: Path, section: Iterable[Statement], last_line: int) -> list[_Properties]:
    """Return the properties of every bone, between its "begin" and "end", including "end"."""
    blocks: list[_Properties] = []
    for line, (word, *values) in section:
        keyword = word.lower()
        is_open = bool(blocks) and "end" not in blocks[-1]
        if is_open == (keyword == "begin"):
            expected = "the end of a bone before the next begins" if is_open else "the begin of a bone"
            fail(path, line, f"expected {expected}, found {keyword[:60]!r}")
        if keyword == "begin":
            blocks.append({})
        elif not keyword.startswith("("):  # limits have a line per degree of freedom
            blocks[-1][keyword] = line, values
    if not blocks or "end" not in blocks[-1]:
        fail(path, last_line, "expected complete :bonedata and :hierarchy sections before the end of the file")
    return blocks


def _units(path: Path, units: _Properties) -> tuple[float | str, bool]:
    """Return the unit of length in metres, "" for none, and whether angles are in degrees."""
    line, words = units.get("length", (0, ["1"]))
    (length,) = numbers(path, line, words, 1, "the unit of length")
    if length <= 0.0:
        fail(path, line, f"expected a positive unit of length, found {length}")
    line, words = units.get("angle", (0, ["deg"]))
    if words not in (["deg"], ["rad"]):
        fail(path, line, f"expected the unit of angles, deg or rad, found {' '.join(words)!r}")
    return UNITS["inch"] / length if "length" in units else "", words == ["deg"]


def _root(path: Path, root: _Properties, last_line: int) -> tuple[_Bone, FloatArray]:
    """Return the root, a bone of zero length whose joint translates and rotates, and its initial position (3,)."""
    line, words = root.get("orientation", (0, ["0"] * 3))
    if any(numbers(path, line, words, 3, "the root's orientation")):
        fail(path, line, f"expected the root's initial orientation 0 0 0, found {' '.join(words)!r}")
    position = np.array(numbers(path, *root.get("position", (0, ["0"] * 3)), 3, "the root's position"))
    if "order" not in root:
        fail(path, last_line, "expected the order of the root's channels in :root")
    line, words = root["order"]
    channels = _channels(path, line, words, (*_TRANSLATIONS, *_ROTATIONS))
    if len(channels) != 6:
        fail(path, line, f"expected TX TY TZ RX RY RZ in any order, found {' '.join(words)!r}")
    line, words = root.get("axis", (0, ["XYZ"]))
    return _Bone(np.zeros(3), np.eye(3), _axis_order(path, line, " ".join(words)), channels), position


def _bone(path: Path, name: str, block: _Properties, degrees: bool) -> _Bone:
    line = block["end"][0]
    if unknown := sorted(block.keys() - _PROPERTIES):
        fail(path, block[unknown[0]][0], f"expected a property of bone {name!r} or its end, found {unknown[0][:60]!r}")
    if not {"direction", "axis", "length"} <= block.keys():
        fail(path, line, f"expected a direction, an axis and a length of bone {name}")
    direction = numbers(path, *block["direction"], 3, f"the direction of {name}")
    (length,) = numbers(path, *block["length"], 1, f"the length of {name}")
    size = float(np.linalg.norm(direction))
    if length < 0.0 or not isclose(size, 1.0, abs_tol=1e-3):  # printed with six digits
        expected = f"a direction of length 1 and a length, not negative, of bone {name}"
        fail(path, line, f"expected {expected}, found {size:.4g} and {length:g}")
    axis_line, words = block["axis"]
    order = _axis_order(path, axis_line, " ".join(words[3:]))
    axis = numbers(path, axis_line, words[:3], 3, f"the axis of {name}")
    rotation = _rotation_matrices(order, np.array([axis["XYZ".index(letter)] for letter in order]), degrees)
    channels = _channels(path, *block["dof"], (*_ROTATIONS, "l")) if "dof" in block else ()
    return _Bone(length * np.array(direction), rotation, order, channels)


def _rotation_matrices(order: str, angles: FloatArray, degrees: bool) -> FloatArray:
    """Return rotations (..., 3, 3) by angles (..., 3) about fixed axes (extrinsic, lower-case orders in scipy)."""
    return scipy.spatial.transform.Rotation.from_euler(order.lower(), angles, degrees=degrees).as_matrix()


def _channels(path: Path, line: int, words: list[str], allowed: tuple[str, ...]) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words)
    if not channels or not set(channels) <= set(allowed) or len(set(channels)) < len(channels):
        fail(path, line, f"expected some of {' '.join(allowed)}, each once, found {' '.join(words)[:60]!r}")
    return channels


def _axis_order(path: Path, line: int, word: str) -> str:
    if word.upper() not in _AXIS_ORDERS:
        fail(path, line, f"expected an order of axes such as XYZ, found {word[:60]!r}")
    return word.upper()


def _tree(
    path: Path, hierarchy: Iterable[Statement], bones: dict[str, _Bone], last_line: int
) -> tuple[tuple[str, ...], list[int]]:
    """Return the joints in the order of the hierarchy, depth first, and their parents."""
    children: dict[str, list[str]] = {}
    placed = {"root"}
    for line, words in hierarchy:
        if words not in (["begin"], ["end"]):
            if unknown := [name for name in words if name not in bones]:
                fail(path, line, f"expected bones of :bonedata, found {unknown[0][:60]!r}")
            for name in words[1:]:
                if name in placed:
                    fail(path, line, f"expected one parent of {name}, found a second one, {words[0]}")
                placed.add(name)
            children.setdefault(words[0], []).extend(words[1:])
    joints: list[str] = []
    parents: list[int] = []
    pending = [("root", -1)]
    while pending:
        name, parent = pending.pop()
        child_names = children.get(name, [f"{name}_end"] if name in bones else [])
        pending += [(child, len(joints)) for child in reversed(child_names)]
        joints.append(name)
        parents.append(parent)
    if unconnected := sorted(set(bones) - set(joints)):
        fail(path, last_line, f"expected {unconnected[0]} to descend from the root in :hierarchy")
    return tuple(joints), parents
