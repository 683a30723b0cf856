"""How well a pose explains the 2-D joints detected or annotated in every view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.core.capabilities import EVIDENCE, KEYPOINTS, RESIDUALS, Traits, offering
from workbench.core.checks import POSITIVE, UP_TO_1, check, one_of
from workbench.core.frame import Frame, View
from workbench.core.observations import Keypoints, Observables, Observed, usable_keypoints
from workbench.core.residual import LOSSES, Loss, ResidualFunction, keypoint_residual, stacked
from workbench.likelihoods.base import PoseLook
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's distribution: few have heavy tails, for joints taken for others."""


@dataclass(frozen=True, eq=False)
class KeypointLikelihood:
    """Joints lie about where they were found, under Student's distribution in the plane, all views together:

        log p = −temper · Σ_v Σ_j (ν / 2 + 1) log(1 + w_j |u_j − û_j|² / (ν σ²))

    with û_j the joint of the pose in the image and w_j its mark's weight, a detector's confidence; up to a constant.
    sigma_px: σ, px of the images used. ν: NU. temper: below 1 flattens the posterior, since a detector errs alike in
    frames that follow each other and N particles cannot follow one much narrower than their spread. A joint behind the
    camera is impossible. which: names of the cameras whose joints count, None for all. Images and the previous pose and
    frame do not matter.

    Least squares minimises √w_j (u_j − û_j) / σ instead, under a loss, "squared", "huber" or "geman_mcclure", which
    bends at `loss_scale` deviations. Raises InputError for numbers out of range and, when it first looks, a camera that
    is not there.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare residuals, and a density of the data where nothing flattens it."""
        return offering(RESIDUALS, *((EVIDENCE,) if keys.get("likelihood_power") == 1.0 else ()), dataset=KEYPOINTS)

    body: Body
    sigma_px: float = 4.0
    likelihood_power: float = 0.3
    cameras: Sequence[str] | None = None
    loss: str = "geman_mcclure"
    loss_scale: float = 1.5

    def __post_init__(self) -> None:
        check("keypoints", self, sigma_px=POSITIVE, likelihood_power=UP_TO_1, loss=one_of(*LOSSES), loss_scale=POSITIVE)

    @property
    def observables(self) -> Observables:
        """Keypoints of some cameras, with the deviation sigma_px."""
        return Observables(sigma_px=self.sigma_px, cameras=None if self.cameras is None else tuple(self.cameras))

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.loss_scale)

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Measure those of the frame's keypoints in the cameras that count, whitened by sigma_px and their weights."""
        seen = [one for one in observed.keypoints if self.cameras is None or one.camera.name in self.cameras]
        own = [keypoint_residual(self.body.skeleton, one.camera, one.joints, one.marks, self.sigma_px) for one in seen]
        return stacked(own)

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Return one over the deviations (M,), 1/px, of keypoints with weights (M,)."""
        return np.asarray(np.sqrt(weights) / self.sigma_px)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseLook:
        """Pick out the joints that were found; poses are all equally likely where there are none."""
        given = [(view.keypoints, view.camera) for view in self._views(frame) if view.keypoints is not None]
        usable = [usable_keypoints(self.body.skeleton, *view) for view in given]
        seen = [keypoints for keypoints in usable if keypoints is not None]
        notes = () if seen else (f"frame {frame.index}: there are no keypoints",)
        return PoseLook("keypoints", partial(self._log_prob, seen), lambda expected_pose: self, notes)

    def _log_prob(self, seen: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
        log_prob, places = np.zeros(len(pose)), joints(self.body.skeleton, pose)
        for view in seen:
            misses = view.camera.project(places[:, view.joints]) - view.marks[:, :2]
            squares = view.marks[:, 2] * (misses**2).sum(axis=2) / (DEGREES_OF_FREEDOM * self.sigma_px**2)
            seen_log_prob = -self.likelihood_power * (0.5 * DEGREES_OF_FREEDOM + 1.0) * np.log1p(squares).sum(axis=1)
            log_prob += np.nan_to_num(seen_log_prob, nan=-np.inf, neginf=-np.inf)
        return log_prob

    def _views(self, frame: Frame) -> tuple[View, ...]:
        if self.cameras is None:
            return frame.views
        if unknown := set(self.cameras) - {view.camera.name for view in frame.views}:
            there = ", ".join(view.camera.name for view in frame.views)
            raise InputError(f"keypoints: which: no camera {min(unknown)!r}, expected some of {there}")
        return tuple(view for view in frame.views if view.camera.name in self.cameras)
