"""The joints that a detector's points are, by the points' names."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.arrays import FloatArray
from workbench.utils.text import plain_name

PointsOfJoints = Mapping[str, tuple[int, ...]]
"""The numbers of the points by joint; a joint is at the mean of its points."""


def layout_joints(layout: Sequence[str]) -> PointsOfJoints:
    """Return the points by joint of a layout in LAYOUTS.

    The centre of the head is half-way between neck and top of the head, if there are both, else between the ears.
    """
    joints: dict[str, tuple[int, ...]] = {name: (layout.index(name),) for name in JOINT_NAMES if name in layout}
    for pair in (("left_ear", "right_ear"), ("neck", "head_top")):
        if set(pair) <= set(layout):
            joints["head_centre"] = tuple(sorted(map(layout.index, pair)))
    return joints


def named_points(names: Sequence[str]) -> PointsOfJoints:
    """Return the points by joint of points that are named after joints, such as LeftKnee, l_knee or knee-left."""
    number_of = {plain_name(name): number for number, name in reversed(list(enumerate(names)))}
    joints: dict[str, tuple[int, ...]] = {}
    for joint in JOINT_NAMES:
        complete = [option for option in _spellings(joint) if all(name in number_of for name in option)]
        if complete:
            joints[joint] = tuple(number_of[name] for name in complete[0])
    return joints


def _spellings(joint: str) -> Iterable[tuple[str, ...]]:
    """Yield the plain names of a joint's points, the best first."""
    yield (joint.replace("_", ""),)
    if joint == "pelvis":
        yield from (("midhip",), ("hips",))
    elif joint == "head_centre":
        yield from (("head",), ("lear", "rear"), ("leftear", "rightear"), ("earleft", "earright"))
    elif "_" in joint:
        side, part = joint.split("_")
        yield from ((side[0] + part,), (part + side,), (part + side[0],))


def joints_of_points(numbers: PointsOfJoints, points: FloatArray, width: int = 3) -> FloatArray:
    """Return joints (J, width) at the mean of their points of (K, ≥ width), with the smallest of their confidences."""
    joints = np.full((len(JOINT_NAMES), width), np.nan)
    for name, selected in numbers.items() if len(points) else ():
        own = points[list(selected), :width]
        joints[JOINT_NAMES.index(name)] = own.mean(axis=0)
        joints[JOINT_NAMES.index(name), 2] = own[:, 2].min()
    return joints
