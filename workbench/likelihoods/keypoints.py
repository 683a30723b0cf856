"""Likelihood of 2-D keypoints, detected or annotated, in every view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.core.capabilities import EVIDENCE, KEYPOINTS, RESIDUALS, Traits, component_traits
from workbench.core.checks import POSITIVE, UP_TO_1, check, one_of
from workbench.core.frame import Frame, View
from workbench.core.observations import Keypoints, Observables, Observed, usable_keypoints
from workbench.core.residual import LOSSES, Loss, ResidualFunction, keypoint_residual, stacked
from workbench.likelihoods.base import PoseFrameLikelihood
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's t distribution; few give heavy tails, for confused joints."""


@dataclass(frozen=True, eq=False)
class KeypointLikelihood:
    """Projected joints scatter about the keypoints with a bivariate Student t distribution, independently in all views:

        log p = −likelihood_power · Σ_v Σ_j (ν / 2 + 1) log(1 + w_j |u_j − û_j|² / (ν σ²))

    up to a constant, with û_j the pose's projected joint, w_j the keypoint's weight, a detector's confidence, and ν
    DEGREES_OF_FREEDOM. A pose with a joint behind the camera has probability 0. Images, the previous pose and the
    previous frame have no influence. Least squares instead minimises a robust loss of √w_j (u_j − û_j) / σ. Raises
    InputError if a parameter is out of range or, when a frame is prepared, a camera does not exist.

    Parameters
    ----------
    body : the person's body.
    sigma_px : σ, px of the images used.
    likelihood_power : below 1 it flattens the posterior, since detection errors are correlated over frames and N
        particles cannot track a posterior much narrower than their spread.
    cameras : names of the cameras whose keypoints are used; None for all.
    loss : of least squares: "squared", "huber" or "geman_mcclure".
    loss_scale : standard deviations at which the loss bends.
    systematic_errors : whether the keypoints are a real detector's. Least squares without a motion model then widens
        its covariances by the definitions of joints, the correlation over frames and displaced cameras, see
        `detector_errors`; the poses do not change.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare residuals, and a density of the data if it is not tempered."""
        return component_traits(
            RESIDUALS, *((EVIDENCE,) if keys.get("likelihood_power") == 1.0 else ()), dataset=KEYPOINTS
        )

    body: Body
    sigma_px: float = 4.0
    likelihood_power: float = 0.3
    cameras: Sequence[str] | None = None
    loss: str = "geman_mcclure"
    loss_scale: float = 1.5
    systematic_errors: bool = False

    def __post_init__(self) -> None:
        check("keypoints", self, sigma_px=POSITIVE, likelihood_power=UP_TO_1, loss=one_of(*LOSSES), loss_scale=POSITIVE)

    @property
    def observables(self) -> Observables:
        """The keypoints of the cameras used, with standard deviation sigma_px and the kind of their errors."""
        cameras = None if self.cameras is None else tuple(self.cameras)
        return Observables(sigma_px=self.sigma_px, cameras=cameras, systematic_errors=self.systematic_errors)

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.loss_scale)

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the residuals of the frame's keypoints in the cameras used, whitened by sigma_px and their weights."""
        keypoints = [one for one in observed.keypoints if self.cameras is None or one.camera.name in self.cameras]
        skeleton, sigma_px = self.body.skeleton, self.sigma_px
        return stacked([keypoint_residual(skeleton, one.camera, one.joints, one.marks, sigma_px) for one in keypoints])

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Return the inverse standard deviations (M,), 1/px, of keypoints with weights (M,)."""
        return np.asarray(np.sqrt(weights) / self.sigma_px)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseFrameLikelihood:
        """Return the likelihood of the frame's usable keypoints; constant if there are none."""
        detected = [(view.keypoints, view.camera) for view in self._views(frame) if view.keypoints is not None]
        usable = [usable_keypoints(self.body.skeleton, *view) for view in detected]
        observed = [keypoints for keypoints in usable if keypoints is not None]
        notes = () if observed else (f"frame {frame.index}: no usable keypoints",)
        return PoseFrameLikelihood("keypoints", partial(self._log_prob, observed), lambda expected_pose: self, notes)

    def _log_prob(self, observed: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
        log_prob, positions = np.zeros(len(pose)), joints(self.body.skeleton, pose)
        for view in observed:
            residuals = view.camera.project(positions[:, view.joints]) - view.marks[:, :2]
            squares = view.marks[:, 2] * (residuals**2).sum(axis=2) / (DEGREES_OF_FREEDOM * self.sigma_px**2)
            view_log_prob = -self.likelihood_power * (0.5 * DEGREES_OF_FREEDOM + 1.0) * np.log1p(squares).sum(axis=1)
            log_prob += np.nan_to_num(view_log_prob, nan=-np.inf, neginf=-np.inf)
        return log_prob

    def _views(self, frame: Frame) -> tuple[View, ...]:
        if self.cameras is None:
            return frame.views
        if unknown := set(self.cameras) - {view.camera.name for view in frame.views}:
            names = ", ".join(view.camera.name for view in frame.views)
            raise InputError(f"keypoints: cameras: unknown camera {min(unknown)!r}; expected some of {names}")
        return tuple(view for view in frame.views if view.camera.name in self.cameras)
