"""Where markers lie beside the joints they stand for, and what errors are left without that."""

import logging
from collections.abc import Sequence

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.step import Step
from workbench.evaluation.pose_errors import mean_distance, moved_joints
from workbench.utils.arrays import FloatArray

log = logging.getLogger(__name__)

ESTIMATED_S = 0.5
"""Time from the first frame that knows a joint, in whose frames its offset is estimated."""


class MarkerOffsets:
    """error_offset_free_mm: mean distance, after a constant offset of each joint, of the expected pose's joints from
    the true ones, where these come from markers: the truth has joints but no pose.

    Markers sit on the skin, or where another anatomist or a detector has the joint. A joint's offset is fixed in the
    frame of the limb that ends in it, its parent's, as the bone is that landmarks are felt on: the true joint less the
    estimated one, the median along each axis over the frames of the first ESTIMATED_S that know the joint. It is
    estimated once, and those frames are not counted. What the estimate gets wrong alike in all of them is taken for an
    offset as well: the error without it stands beside error_abs_mm and does not replace it.

    error_abs_offsets_removed_mm, error_rel_offsets_removed_mm: the same over all frames with offsets that are the
    medians over all of them, of error_abs_mm and, after moving pelvis onto pelvis, of error_rel_mm: the least that a
    joint's definition leaves, as the offsets are fitted to the errors that are counted.

    moving: as for `errors.step_errors`, whose joints are measured.
    """

    def __init__(self, skeleton: Skeleton, moving: Sequence[str] = POSE_NAMES) -> None:
        self._skeleton, self._measured = skeleton, moved_joints(skeleton, moving)
        self._since = np.full(len(skeleton.names), np.nan)
        self._seen: dict[int, list[FloatArray]] = {joint: [] for joint in self._measured}
        self._apart: dict[str, list[FloatArray]] = {"abs": [], "rel": []}
        self.offsets = np.full((len(skeleton.names), 3), np.nan)
        """(J, 3), m, in the parents' frames; NaN for joints that are not measured or not yet known."""

    @property
    def lengths_mm(self) -> dict[str, float]:
        """Return offset_<joint>_mm: how far each marker lies from its joint, of those known."""
        offsets = {f"offset_{self._skeleton.names[joint]}_mm": self.offsets[joint] for joint in self._measured}
        return {name: 1e3 * float(np.linalg.norm(xyz)) for name, xyz in offsets.items() if np.isfinite(xyz).all()}

    @property
    def removed_mm(self) -> dict[str, float]:
        """Return error_abs_offsets_removed_mm and error_rel_offsets_removed_mm of all frames so far; of none, none."""
        errors: dict[str, float] = {}
        for kind, apart in self._apart.items():
            known = [row[np.isfinite(row).all(axis=1)] for row in np.swapaxes(apart, 0, 1)] if apart else []
            residuals = [np.linalg.norm(row - np.median(row, axis=0), axis=1) for row in known if len(row)]
            if residuals:
                errors[f"error_{kind}_offsets_removed_mm"] = 1e3 * float(np.concatenate(residuals).mean())
        return errors

    def add(self, step: Step) -> dict[str, float]:
        """Return the error in this frame, over the joints that it knows and whose offset frames before it gave."""
        truth = step.frame.truth
        if truth is None or truth.joints is None or truth.pose is not None:
            return {}
        frames = forward(self._skeleton, step.expected_pose[None])
        limbs, places = frames.rotations[0, self._skeleton.parents], frames.positions[0]
        apart = truth.joints - places
        self._estimate(step.frame.time_s, np.einsum("jba,jb->ja", limbs, apart))
        for kind, each in (("abs", apart), ("rel", apart - apart[0])):
            self._apart[kind].append(np.einsum("jba,jb->ja", limbs, each)[self._measured])
        moved = places + np.einsum("jab,jb->ja", limbs, self.offsets)
        error = 1e3 * float(mean_distance(moved[self._measured], truth.joints[self._measured]))
        return {"error_offset_free_mm": error} if np.isfinite(error) else {}

    def _estimate(self, time_s: float, apart: FloatArray) -> None:
        """Take in what lies between joints (J, 3), m, or close the estimates whose time is over."""
        known = len(self.lengths_mm)
        for joint, seen in self._seen.items():
            if np.isnan(self._since[joint]) and np.isfinite(apart[joint]).all():
                self._since[joint] = time_s
            if time_s - self._since[joint] > ESTIMATED_S and np.isnan(self.offsets[joint]).any():
                self.offsets[joint] = np.median(seen, axis=0)
            elif time_s - self._since[joint] <= ESTIMATED_S and np.isfinite(apart[joint]).all():
                seen.append(apart[joint])
        if len(self.lengths_mm) > known:
            lengths = ", ".join(
                f"{name[len('offset_') : -len('_mm')]} {mm:.0f}" for name, mm in self.lengths_mm.items()
            )
            log.info("markers lie beside the joints, mm: %s", lengths)
