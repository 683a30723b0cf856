"""The joints that a detector's points are, by the points' names."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES
from workbench.utils.arrays import FloatArray
from workbench.utils.text import plain_name

PointsOfJoints = Mapping[str, tuple[int, ...]]
"""The numbers of the points by joint, or end of a foot; a joint is at the mean of its points."""
FOOT_OF_ANKLE = slice(6, 12)
"""Columns, in the rows of the ankles, of the heel and the toes of the same foot: [u px, v px, confidence] of each. What
follows, exchanges or interpolates an ankle then does so with its foot."""
_TOES = (("big_toe", "small_toe"), ("toes",), ("toe",), ("foot_index",), ("big_toe",))
"""Names of the points that are a foot's toes, the best first: the toes' end is midway between big and small toe."""


def layout_joints(layout: Sequence[str]) -> PointsOfJoints:
    """Return the points by joint of a layout in LAYOUTS.

    The centre of the head is half-way between neck and top of the head, if there are both, else between the ears.
    """
    joints: dict[str, tuple[int, ...]] = {name: (layout.index(name),) for name in JOINT_NAMES if name in layout}
    for pair in (("left_ear", "right_ear"), ("neck", "head_top")):
        if set(pair) <= set(layout):
            joints["head_centre"] = tuple(sorted(map(layout.index, pair)))
    return joints | _feet(lambda name: layout.index(name) if name in layout else None)


def named_points(names: Sequence[str]) -> PointsOfJoints:
    """Return the points by joint of points that are named after joints, such as LeftKnee, l_knee or knee-left."""
    number_of = {plain_name(name): number for number, name in reversed(list(enumerate(names)))}
    joints: dict[str, tuple[int, ...]] = {}
    for joint in JOINT_NAMES:
        complete = [option for option in _spellings(joint) if all(name in number_of for name in option)]
        if complete:
            joints[joint] = tuple(number_of[name] for name in complete[0])
    if not joints:
        return {}

    def number(point: str) -> int | None:
        side, _, part = point.partition("_")
        part = part.replace("_", "")
        return next((number_of[name] for name in _of_side(side, part) if name in number_of), None)

    return joints | _feet(number)


def _feet(number_of: Callable[[str], int | None]) -> dict[str, tuple[int, ...]]:
    """Return the points of those of FOOT_POINTS that there are, by the numbers of the points with a name."""
    found = dict[str, tuple[int, ...]]()
    for end in FOOT_POINTS:
        side, name = end.split("_")
        for parts in (("heel",),) if name == "heel" else _TOES:
            numbers = [number_of(f"{side}_{part}") for part in parts]
            if end not in found and None not in numbers:
                found[end] = tuple(number for number in numbers if number is not None)
    return found


def _spellings(joint: str) -> Iterable[tuple[str, ...]]:
    """Yield the plain names of a joint's points, the best first."""
    yield (joint.replace("_", ""),)
    if joint == "pelvis":
        yield from (("midhip",), ("hips",))
    elif joint == "head_centre":
        yield from (("head",), ("lear", "rear"), ("leftear", "rightear"), ("earleft", "earright"))
    elif "_" in joint:
        yield from ((name,) for name in _of_side(*joint.split("_"))[1:])


def _of_side(side: str, part: str) -> tuple[str, ...]:
    """Return the plain names of a part of one side, the best first."""
    return side + part, side[0] + part, part + side, part + side[0]


def joints_of_points(numbers: PointsOfJoints, points: FloatArray, width: int = 3) -> FloatArray:
    """Return joints (..., J, width) at the mean of their points of (..., K, ≥ width), with the smallest of their
    confidences; (..., J, 12) with FOOT_OF_ANKLE where there are points of feet."""
    has_feet = any(name in numbers for name in FOOT_POINTS)
    n_columns = FOOT_OF_ANKLE.stop if has_feet else width
    joints = np.full((*points.shape[:-2], len(JOINT_NAMES), n_columns), np.nan)
    for name, selected in numbers.items() if points.size else ():
        own = points[..., list(selected), :width]
        mean = own.mean(axis=-2)
        mean[..., 2] = own[..., 2].min(axis=-1)
        if name in FOOT_POINTS:
            first = FOOT_OF_ANKLE.start + 3 * name.endswith("toes")
            joints[..., JOINT_NAMES.index(f"{name.split('_')[0]}_ankle"), first : first + 3] = mean[..., :3]
        else:
            joints[..., JOINT_NAMES.index(name), :width] = mean
    return joints


def foot_points(joints: FloatArray) -> FloatArray | None:
    """Return FOOT_POINTS (..., 4, 3), [u px, v px, confidence], of joints (..., J, 12); None for fewer columns."""
    if joints.shape[-1] < FOOT_OF_ANKLE.stop:
        return None
    ankles = [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]
    return joints[..., ankles, FOOT_OF_ANKLE].reshape(*joints.shape[:-2], len(FOOT_POINTS), 3)
