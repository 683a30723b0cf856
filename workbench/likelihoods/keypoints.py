"""Likelihood of 2-D keypoints, detected or annotated, in every view."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.core.capabilities import EVIDENCE, KEYPOINTS, RESIDUALS, Traits, component_traits
from workbench.core.checks import POSITIVE, UP_TO_1, check, one_of
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache, without_images
from workbench.core.losses import DEGREES_OF_FREEDOM, KEYPOINT_LOSS, LOSSES, Loss
from workbench.core.observations import Keypoints, Observables, Observed, person_px, usable_keypoints
from workbench.core.residual import ResidualFunction, keypoint_residual, stacked
from workbench.likelihoods.base import PoseFrameLikelihood
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

SIGMA_HEIGHTS = 0.015
"""σ in heights of the person in the image: detectors' errors are 1 to 2 %."""
_MAX_FRAMES = 100
"""Frames with keypoints whose median height is used."""


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
    sigma_px : σ, px of the images used; None: SIGMA_HEIGHTS of the person's height in the clip's images.
    likelihood_power : below 1 it flattens the posterior, since detection errors are correlated over frames and N
        particles cannot track a posterior much narrower than their spread.
    cameras : names of the cameras whose keypoints are used; None for all.
    loss : of least squares: "squared", "huber" or "geman_mcclure".
    loss_scale : standard deviations at which the loss bends.
    systematic_errors : whether the keypoints are a real detector's. Least squares without a motion model then widens
        its covariances by the definitions of joints, the correlation over frames and displaced cameras, see
        `detector_errors`; the poses do not change.
    depth_sigma_m : of least squares without a motion model and with a single camera: standard deviation, m, of the
        depth of a bone that is less deep than by the detector's world landmarks, where it provides them; None: they
        are not used. Their depths' errors are 0.1 m (root mean square).
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare residuals, and a density of the data if it is not tempered."""
        return component_traits(
            RESIDUALS, *((EVIDENCE,) if keys.get("likelihood_power") == 1.0 else ()), dataset=KEYPOINTS
        )

    body: Body
    sigma_px: float | None = 4.0
    likelihood_power: float = 0.3
    cameras: Sequence[str] | None = None
    loss: str = KEYPOINT_LOSS.name
    loss_scale: float = KEYPOINT_LOSS.scale
    systematic_errors: bool = False
    depth_sigma_m: float | None = None
    clip: FrameCache | None = None

    def __post_init__(self) -> None:
        check("keypoints", self, likelihood_power=UP_TO_1, loss=one_of(*LOSSES), loss_scale=POSITIVE)
        for name in ("sigma_px", "depth_sigma_m"):
            if getattr(self, name) is not None:
                check("keypoints", self, **{name: POSITIVE})
        if self.sigma_px is None and self.clip is None:
            raise InputError("keypoints: expected sigma_px, or a clip to measure the person's height in")

    @property
    def observables(self) -> Observables:
        """The keypoints of the cameras used, with their standard deviations and the kind of their errors."""
        cameras = None if self.cameras is None else tuple(self.cameras)
        return Observables(
            sigma_px=self.std_px, cameras=cameras, depth_sigma_m=self.depth_sigma_m,
            systematic_errors=self.systematic_errors,
        )  # fmt: skip

    @cached_property
    def std_px(self) -> float:
        """σ, px."""
        if self.sigma_px is not None:
            return self.sigma_px
        detected = (self._keypoints(frame) for frame in without_images(self.clip or ()))
        heights = [person_px(views) for views in islice(filter(None, detected), _MAX_FRAMES)]
        if not heights:
            raise InputError("keypoints: expected usable keypoints to derive sigma_px from, found none; set sigma_px")
        sigma_px = SIGMA_HEIGHTS * max(float(np.median(heights)), 1.0)
        log.info("standard deviation of a keypoint: %.1f px, %g of the person's height", sigma_px, SIGMA_HEIGHTS)
        return sigma_px

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.loss_scale)

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the residuals of the frame's keypoints in the cameras used, whitened by sigma_px and their weights."""
        keypoints = [one for one in observed.keypoints if self.cameras is None or one.camera.name in self.cameras]
        skeleton, std_px = self.body.skeleton, self.std_px
        return stacked(
            [keypoint_residual(skeleton, one.camera, one.joints, one.detections, std_px) for one in keypoints]
        )

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Return the inverse standard deviations (M,), 1/px, of keypoints with weights (M,)."""
        return np.asarray(np.sqrt(weights) / self.std_px)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseFrameLikelihood:
        """Return the likelihood of the frame's usable keypoints; constant if there are none."""
        observed = self._keypoints(frame)
        notes = () if observed else (f"frame {frame.index}: no usable keypoints",)
        return PoseFrameLikelihood("keypoints", partial(self._log_prob, observed), lambda expected_pose: self, notes)

    def _log_prob(self, observed: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
        log_prob, positions = np.zeros(len(pose)), joints(self.body.skeleton, pose)
        for view in observed:
            residuals = view.camera.project(positions[:, view.joints]) - view.detections[:, :2]
            squares = view.detections[:, 2] * (residuals**2).sum(axis=2) / (DEGREES_OF_FREEDOM * self.std_px**2)
            view_log_prob = -self.likelihood_power * (0.5 * DEGREES_OF_FREEDOM + 1.0) * np.log1p(squares).sum(axis=1)
            log_prob += np.nan_to_num(view_log_prob, nan=-np.inf, neginf=-np.inf)
        return log_prob

    def _keypoints(self, frame: Frame) -> list[Keypoints]:
        """Return the frame's usable keypoints by view."""
        usable = [
            usable_keypoints(self.body.skeleton, view.keypoints, view.camera, feet=view.feet)
            for view in self._views(frame)
            if view.keypoints is not None
        ]
        return [keypoints for keypoints in usable if keypoints is not None]

    def _views(self, frame: Frame) -> tuple[View, ...]:
        if self.cameras is None:
            return frame.views
        if unknown := set(self.cameras) - {view.camera.name for view in frame.views}:
            names = ", ".join(view.camera.name for view in frame.views)
            raise InputError(f"keypoints: cameras: unknown camera {min(unknown)!r}; expected some of {names}")
        return tuple(view for view in frame.views if view.camera.name in self.cameras)
