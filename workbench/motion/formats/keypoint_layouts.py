"""Layouts of 2-D detectors: which points are which joints, and which layout a detector's points have."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.formats.joint_names import plain
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

Layout = Mapping[str, tuple[int, ...]]
"""The detector's points by joint; a joint is at their mean."""

_COCO_LIMBS = {
    f"{side}_{joint}": (5 + 2 * j + s,)
    for j, joint in enumerate(("shoulder", "elbow", "wrist", "hip", "knee", "ankle"))
    for s, side in enumerate(("left", "right"))
}
_BLAZEPOSE_LIMBS = {
    f"{side}_{joint}": (first + s,)
    for joint, first in (("shoulder", 11), ("elbow", 13), ("wrist", 15), ("hip", 23), ("knee", 25), ("ankle", 27))
    for s, side in enumerate(("left", "right"))
}
_BODY_ARMS = {
    "right_shoulder": (2,), "right_elbow": (3,), "right_wrist": (4,),
    "left_shoulder": (5,), "left_elbow": (6,), "left_wrist": (7,),
}  # fmt: skip
_BODY_25B = _COCO_LIMBS | {"neck": (17,), "head_centre": (17, 18)}
_HALPE_26 = _COCO_LIMBS | {"neck": (18,), "head_centre": (17, 18), "pelvis": (19,)}
_COCO_17 = _COCO_LIMBS | {"head_centre": (3, 4)}
_MPI_LEGS = {
    "right_hip": (8,), "right_knee": (9,), "right_ankle": (10,),
    "left_hip": (11,), "left_knee": (12,), "left_ankle": (13,),
}  # fmt: skip
LAYOUTS: Mapping[str, tuple[int, Layout]] = {
    "BODY_25": (25, _BODY_ARMS | {
        "pelvis": (8,), "right_hip": (9,), "right_knee": (10,), "right_ankle": (11,),
        "left_hip": (12,), "left_knee": (13,), "left_ankle": (14,), "head_centre": (17, 18),
    }),
    "BODY_25B": (25, _BODY_25B),
    "BODY_135": (135, _BODY_25B),
    "HALPE_26": (26, _HALPE_26),
    "HALPE_136": (136, _HALPE_26),
    "COCO_18": (18, _BODY_ARMS | _MPI_LEGS | {"head_centre": (16, 17)}),
    "COCO_17": (17, _COCO_17),
    "COCO_133": (133, _COCO_17),
    "MPII_16": (16, {
        "right_ankle": (0,), "right_knee": (1,), "right_hip": (2,), "left_hip": (3,), "left_knee": (4,),
        "left_ankle": (5,), "pelvis": (6,), "neck": (8,), "head_centre": (8, 9), "right_wrist": (10,),
        "right_elbow": (11,), "right_shoulder": (12,), "left_shoulder": (13,), "left_elbow": (14,), "left_wrist": (15,),
    }),
    "MPI_15": (15, _BODY_ARMS | _MPI_LEGS),
    "BLAZEPOSE_33": (33, _BLAZEPOSE_LIMBS | {"head_centre": (7, 8)}),
}  # fmt: skip
"""Numbers of points, and points by joint. The centre of the head is half-way between neck and top of the head, if there
is one, else between the ears. OpenPose's own "neck", the middle of the shoulders, is below ours and is excluded. The
whole-body layouts, with points of face and hands, begin with those of a body."""
_AVERAGE = from_height(1.0)
_BONES = {
    (f"{side}_{a}", f"{side}_{b}"): length
    for side in ("left", "right")
    for a, b, length in (
        ("shoulder", "elbow", _AVERAGE.upper_arm), ("elbow", "wrist", _AVERAGE.forearm), ("shoulder", "hip", 0.288),
        ("hip", "knee", _AVERAGE.thigh), ("knee", "ankle", _AVERAGE.calf),
    )
}  # fmt: skip
"""Lengths over a person's height, see `from_height`; the shoulder is 0.288 above the hip there."""
_NEIGHBOURS: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "BODY_25": ((0, 15, 16, 17, 18), (14, 19, 20, 21), (11, 22, 23, 24)),
    "BODY_25B": ((0, 1, 2, 3, 4), (15, 19, 20, 21), (16, 22, 23, 24)),
}
"""Points of the face and of either foot."""
_NEIGHBOUR_LENGTH = 0.06
"""Distance of the first point of each group from the others, over the height."""
_MAX_LOG_RATIO = 1.5
"""Largest deviation of a bone that counts, for robustness; foreshortened bones have all lengths down to zero."""
_CLEAR = 0.1
"""Smallest evidence of a clear decision."""


def matching_layout(people: Sequence[FloatArray]) -> tuple[str, float]:
    """Return the name of the layout of detected people (K, 3), and the evidence for it.

    Of layouts with the same number of points, the right one gives bones that have the proportions of a body: the mean
    absolute log ratio of their lengths in the image to a body's, scaled to each person, is least. The evidence is the
    median over people of its difference to the second best layout, infinite without a second one. Reprojection between
    cameras cannot decide: a point is the same point in all cameras under every layout. Raises InputError for an unknown
    number.
    """
    n_points = len(people[0])
    names = [name for name, (n, _) in LAYOUTS.items() if n == n_points]
    if not names:
        options = ", ".join(f"{n} ({name})" for name, (n, _) in LAYOUTS.items())
        raise InputError(f"expected one of {options} points per person, found {n_points}")
    if len(names) == 1:
        return names[0], np.inf
    points = np.stack(people)[..., :2]
    deviations = np.stack([_deviation(name, points) for name in names])
    usable = np.isfinite(deviations).all(axis=0)
    excess = deviations[:, usable] - deviations[:, usable].min(axis=0)
    medians = np.median(excess, axis=1) if usable.any() else np.zeros(len(names))
    order = np.argsort(medians, kind="stable")
    return names[order[0]], float(medians[order[1]] - medians[order[0]])


def is_clear(evidence: float) -> bool:
    """Return whether the evidence for a layout is clear, see `matching_layout`."""
    return evidence >= _CLEAR


def layout_named(name: str, n_points: int) -> str:
    """Return the name of a layout that is set; raises InputError for an unknown one or another number of points."""
    if name not in LAYOUTS:
        raise InputError(f"keypoint_layout: expected one of {', '.join(LAYOUTS)}, found {name!r}")
    if LAYOUTS[name][0] != n_points:
        raise InputError(f"keypoint_layout: {name} has {LAYOUTS[name][0]} points, found {n_points} per person")
    return name


def named_points(names: Sequence[str]) -> Layout:
    """Return the points by joint of points that are named after joints, such as LeftKnee, l_knee or knee-left."""
    number_of = {plain(name): number for number, name in reversed(list(enumerate(names)))}
    layout: dict[str, tuple[int, ...]] = {}
    for joint in JOINT_NAMES:
        found = [option for option in _spellings(joint) if all(name in number_of for name in option)]
        if found:
            layout[joint] = tuple(number_of[name] for name in found[0])
    return layout


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


def joints_of_points(layout: Layout, points: FloatArray, width: int = 3) -> FloatArray:
    """Return joints (J, width) at the mean of their points of (K, ≥ width), with the smallest of their confidences."""
    joints = np.full((len(JOINT_NAMES), width), np.nan)
    for name, numbers in layout.items() if len(points) else ():
        selected = points[list(numbers), :width]
        joints[JOINT_NAMES.index(name)] = selected.mean(axis=0)
        joints[JOINT_NAMES.index(name), 2] = selected[:, 2].min()
    return joints


def _deviation(layout: str, points: FloatArray) -> FloatArray:
    """Return the mean deviation of a layout's bones from a body's proportions, of people (n, K, 2); NaN for none."""
    joints = LAYOUTS[layout][1]
    pairs = {(joints[a][0], joints[b][0]): length for (a, b), length in _BONES.items()}
    groups = _NEIGHBOURS.get(layout, ())
    pairs |= {(group[0], other): _NEIGHBOUR_LENGTH for group in groups for other in group[1:]}
    first, second = np.array(list(pairs)).T
    lengths = np.linalg.norm(points[:, first] - points[:, second], axis=2)
    ratios = np.log(np.maximum(lengths, 1e-9) / np.array(list(pairs.values())))
    measured = np.isfinite(ratios)
    scales = np.array(
        [np.median(row[there]) if there.any() else np.nan for row, there in zip(ratios, measured, strict=True)]
    )
    deviations = np.minimum(np.abs(ratios - scales[:, None]), _MAX_LOG_RATIO)
    count = measured.sum(axis=1)
    return np.where(count > 2, np.where(measured, deviations, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
