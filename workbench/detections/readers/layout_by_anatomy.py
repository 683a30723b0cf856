"""The layout of a detector's points by their number and, where several layouts have it, by a body's proportions."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from workbench.body.shape import from_height
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.named_points import layout_joints, named_points
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.nan_statistics import nan_mean, nan_median

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
_NEIGHBOURS = {
    "nose": ("left_eye", "right_eye", "left_ear", "right_ear"),
    **{f"{side}_ankle": tuple(f"{side}_{part}" for part in ("big_toe", "small_toe", "heel"))
       for side in ("left", "right")},
}  # fmt: skip
"""Points of the face and of either foot that are near the first one."""
_NEIGHBOUR_LENGTH = 0.06
"""Distance of the first point of each group from the others, over the height."""
_MAX_LOG_RATIO = 1.5
"""Largest deviation of a bone that counts, for robustness; foreshortened bones have all lengths down to zero."""
CLEAR = 0.1
"""Smallest evidence of a clear decision, see `matching_layout`."""


def matching_layout(source: str, people: Sequence[FloatArray]) -> tuple[str, float]:
    """Return the name of the layout of detected people (K, 3) in a source, and the evidence for it.

    Of layouts with the same number of points, the right one gives bones that have the proportions of a body: the mean
    absolute log ratio of their lengths in the image to a body's, scaled to each person, is least. The evidence is the
    median over people of its difference to the second best layout, infinite without a second one. Reprojection between
    cameras cannot decide: a point is the same point in all cameras under every layout. Raises InputError for an unknown
    number.
    """
    n_points = len(people[0])
    check_number_of_points(source, n_points)
    names = [name for name, points in LAYOUTS.items() if len(points) == n_points]
    if len(names) == 1:
        return names[0], np.inf
    points = np.stack(people)[..., :2]
    deviations = np.stack([_deviation(LAYOUTS[name], points) for name in names])
    usable = np.isfinite(deviations).all(axis=0)
    excess = deviations[:, usable] - deviations[:, usable].min(axis=0)
    medians = np.median(excess, axis=1) if usable.any() else np.zeros(len(names))
    order = np.argsort(medians, kind="stable")
    return names[order[0]], float(medians[order[1]] - medians[order[0]])


def check_number_of_points(source: object, n_points: int) -> None:
    """Raise InputError, with the source, for a number of points that no layout has."""
    if all(len(points) != n_points for points in LAYOUTS.values()):
        options = ", ".join(f"{len(points)} ({name})" for name, points in LAYOUTS.items())
        raise InputError(f"{source}: expected one of {options} points per person, found {n_points}")


@lru_cache  # equal in all files of a folder
def unlike_layouts(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of points; () where no limb is among them, and where a layout, which also states the points of
    the head, has the points of all limbs at the same places."""
    limbs = {name: points for name, points in named_points(names).items() if name.startswith(("left_", "right_"))}
    layouts = [layout_joints(points) for points in LAYOUTS.values() if len(points) == len(names)]
    is_layout = any(all(layout.get(name) == points for name, points in limbs.items()) for layout in layouts)
    return names if limbs and not is_layout else ()


def check_layout(source: str, name: str, n_points: int) -> None:
    """Raise InputError for an unknown layout that is set, and for one with another number of points."""
    if name not in LAYOUTS:
        raise InputError(f"{source}: keypoint_layout: expected one of {', '.join(LAYOUTS)}, found {name!r}")
    if (expected := len(LAYOUTS[name])) != n_points:
        raise InputError(f"{source}: keypoint_layout: {name} has {expected} points, found {n_points} per person")


def _deviation(layout: tuple[str, ...], points: FloatArray) -> FloatArray:
    """Return the mean deviation of a layout's bones from a body's proportions, of people (n, K, 2); NaN for none."""
    joints = layout_joints(layout)
    pairs = {(joints[a][0], joints[b][0]): length for (a, b), length in _BONES.items()}
    for centre, others in _NEIGHBOURS.items():
        near = sorted(layout.index(other) for other in others if centre in layout and other in layout)
        pairs |= {(layout.index(centre), other): _NEIGHBOUR_LENGTH for other in near}
    first, second = np.array(list(pairs)).T
    lengths = np.linalg.norm(points[:, first] - points[:, second], axis=2)
    ratios = np.log(np.maximum(lengths, 1e-9) / np.array(list(pairs.values())))
    deviations = np.minimum(np.abs(ratios - nan_median(ratios)[:, None]), _MAX_LOG_RATIO)
    return np.where(np.isfinite(ratios).sum(axis=1) > 2, nan_mean(deviations), np.nan)
