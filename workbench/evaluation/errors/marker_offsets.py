"""Constant offsets of markers from the joints they stand for, and errors corrected by them."""

import logging
from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.step import Step
from workbench.evaluation.errors.pose_errors import mean_distance, moved_joints
from workbench.utils.arrays import FloatArray

log = logging.getLogger(__name__)

ESTIMATED_S = 0.5
"""Duration, from the first frame with a true joint, of the frames that its offset is estimated from."""


class MarkerOffsets:
    """Estimates markers' offsets and returns mpjpe_abs_marker_corrected_mm, the mean joint error corrected by them.

    It applies where the truth has joints but no pose, as from markers. Markers lie on the skin, and anatomists and
    detectors define joints differently. A joint's offset is constant in the frame of the limb that ends in it, its
    parent's, since landmarks are defined on bones. It is the true joint minus the estimated one, the median along each
    axis over the frames of the first ESTIMATED_S with this joint. These frames have no corrected error. A constant
    error of the estimate in all of them counts as an offset, too: the corrected error supplements mpjpe_abs_mm and does
    not replace it.

    mpjpe_abs_offset_corrected_mm and mpjpe_offset_corrected_mm are mpjpe_abs_mm and mpjpe_mm, corrected by offsets that
    are medians over all frames. They are lower bounds over the definitions of a joint, fitted to the same errors.

    Parameters
    ----------
    skeleton : of the estimate.
    moving : the parameters whose joints are measured, see `pose_errors.step_errors`.
    """

    def __init__(self, skeleton: Skeleton, moving: Sequence[str] = POSE_NAMES) -> None:
        self._skeleton, self._measured = skeleton, moved_joints(skeleton, moving)
        self._since = np.full(len(skeleton.names), np.nan)
        self._samples: dict[int, list[FloatArray]] = {joint: [] for joint in self._measured}
        self._residuals: dict[str, list[FloatArray]] = {"mpjpe_abs": [], "mpjpe": []}
        self.offsets = np.full((len(skeleton.names), 3), np.nan)
        """(J, 3), m, in the parents' frames; NaN for joints that are not measured or not yet estimated."""

    @property
    def lengths_mm(self) -> dict[str, float]:
        """Return marker_offset_<joint>_mm, the lengths of the estimated offsets."""
        offsets = {self._skeleton.names[joint]: self.offsets[joint] for joint in self._measured}
        return {
            f"marker_offset_{name}_mm": 1e3 * float(np.linalg.norm(xyz))
            for name, xyz in offsets.items()
            if np.isfinite(xyz).all()
        }

    @property
    def corrected_mm(self) -> dict[str, float]:
        """Return mpjpe_abs_offset_corrected_mm and mpjpe_offset_corrected_mm of the frames so far; {} without any."""
        errors: dict[str, float] = {}
        for name, residuals in self._residuals.items():
            each = [row[np.isfinite(row).all(axis=1)] for row in np.swapaxes(residuals, 0, 1)] if residuals else []
            corrected = [np.linalg.norm(row - np.median(row, axis=0), axis=1) for row in each if len(row)]
            if corrected:
                errors[f"{name}_offset_corrected_mm"] = 1e3 * float(np.concatenate(corrected).mean())
        return errors

    def add(self, step: Step) -> dict[str, float]:
        """Return the corrected error in this frame, over the joints whose offset is estimated from earlier frames."""
        truth = step.frame.truth
        if truth is None or truth.joints is None or truth.pose is not None:
            return {}
        frames = step.expected_frames(self._skeleton)
        limbs, places = frames.rotations[0, self._skeleton.parents], frames.positions[0]
        residuals = truth.joints - places
        self._estimate(step.frame.time_s, np.einsum("jba,jb->ja", limbs, residuals))
        for name, each in (("mpjpe_abs", residuals), ("mpjpe", residuals - residuals[0])):
            self._residuals[name].append(np.einsum("jba,jb->ja", limbs, each)[self._measured])
        moved = places + np.einsum("jab,jb->ja", limbs, self.offsets)
        error = 1e3 * float(mean_distance(moved[self._measured], truth.joints[self._measured]))
        return {"mpjpe_abs_marker_corrected_mm": error} if np.isfinite(error) else {}

    def _estimate(self, time_s: float, residuals: FloatArray) -> None:
        """Add residuals of joints (J, 3), m, in their parents' frames, or finish the estimates after ESTIMATED_S."""
        n_estimated = len(self.lengths_mm)
        for joint, samples in self._samples.items():
            if np.isnan(self._since[joint]) and np.isfinite(residuals[joint]).all():
                self._since[joint] = time_s
            if time_s - self._since[joint] > ESTIMATED_S and np.isnan(self.offsets[joint]).any():
                self.offsets[joint] = np.median(samples, axis=0)
            elif time_s - self._since[joint] <= ESTIMATED_S and np.isfinite(residuals[joint]).all():
                samples.append(residuals[joint])
        if len(self.lengths_mm) > n_estimated:
            lengths = ", ".join(
                f"{name[len('marker_offset_') : -len('_mm')]} {mm:.0f}" for name, mm in self.lengths_mm.items()
            )
            log.info("offsets of markers from joints, mm: %s", lengths)
