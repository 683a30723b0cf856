"""A person's height by the lengths of the limbs, and these lengths by the positions of joints."""

from collections.abc import Mapping

import numpy as np

from workbench.body.shape import from_height
from workbench.body.skeleton import joint_of
from workbench.utils.arrays import FloatArray

LIMBS = {
    "upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"),
    "thigh": ("hip", "knee"), "calf": ("knee", "ankle"),
}  # fmt: skip
"""Limbs of either side, between these joints."""
SIDES = ("left", "right")


def limb_lengths(joints: FloatArray) -> dict[str, float]:
    """Return the limbs' lengths, m, medians over sides and frames of joints (F, J, 3), m; of limbs in any frame."""
    lengths = {}
    for limb, ends in LIMBS.items():
        sides = [[joint_of(joints, f"{side}_{end}") for end in ends] for side in SIDES]
        each = [np.linalg.norm(upper - lower, axis=1) for upper, lower in sides]
        valid = np.concatenate(each)
        valid = valid[np.isfinite(valid)]
        if len(valid):
            lengths[limb] = float(np.median(valid))
    return lengths


def usual_height(lengths: Mapping[str, float]) -> float:
    """Return the height, m, of an average person with limbs (m, by name) as long, the mean over their logarithms."""
    unit = from_height(1.0)
    return float(np.exp(np.mean([np.log(length / getattr(unit, limb)) for limb, length in lengths.items()])))


def stature(joints: Mapping[str, FloatArray]) -> float | None:
    """Return a person's height by the lengths of the limbs, in the unit of the joints' positions (F, 3); None without
    any limb. Each limb implies a height by an average person's proportions; their median is returned, which unlike
    `usual_height` tolerates limbs of no length and wrong joints, as in files of other programs."""
    average, heights = from_height(1.0), []
    for side in SIDES:
        for limb, ends in LIMBS.items():
            upper, lower = (joints.get(f"{side}_{end}") for end in ends)
            if upper is not None and lower is not None:
                lengths = np.linalg.norm(upper - lower, axis=-1)
                if np.isfinite(lengths).any():
                    heights.append(np.nanmedian(lengths) / getattr(average, limb))
    return float(np.median(heights)) if heights else None
