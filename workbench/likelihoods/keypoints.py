"""How well a pose explains the 2-D joints that a detector found, or somebody marked, in every view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import Frame, View
from workbench.core.observation_residuals import keypoint_residual
from workbench.core.observations import Observables, Observed
from workbench.core.residual import LOSSES, Loss, ResidualFunction, stacked
from workbench.core.traits import EVIDENCE, KEYPOINTS, RESIDUALS, Traits, offering
from workbench.errors import InputError
from workbench.likelihoods.constants import POSITIVE, TEMPER, check, check_choice
from workbench.likelihoods.looks import PoseLook


@dataclass(frozen=True, eq=False)
class SeenJoints:
    """The K joints that were found in one view. joints: (K,), of the skeleton. marks: (K, 3), u and v px, weight."""

    camera: Camera
    joints: IntArray
    marks: FloatArray


@dataclass(frozen=True, eq=False)
class KeypointLikelihood:
    """Joints lie about where they were found, under Student's distribution in the plane, all views together:

        log p = −temper · Σ_v Σ_j (ν / 2 + 1) log(1 + w_j |u_j − û_j|² / (ν σ²))

    with û_j the joint of the pose in the image and w_j its mark's weight, a detector's confidence; up to a constant.
    sigma_px: σ, px of the images used. nu: ν degrees of freedom; few have heavy tails, as detectors, which now and
    then take one joint for another, do. temper: below 1 flattens the posterior, since a detector errs alike in frames
    that follow each other and N particles cannot follow one much narrower than their spread. A joint behind the camera
    is impossible. which: names of the cameras whose joints count, None for all. Images and the previous pose and frame
    do not matter.

    Least squares minimises √w_j (u_j − û_j) / σ instead, under a loss, "squared", "huber" or "geman_mcclure", which
    bends at `scale` deviations. Raises InputError for numbers out of range and, when it first looks, a camera that is
    not there.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare residuals, and a density of the data where nothing flattens it."""
        return offering(RESIDUALS, *((EVIDENCE,) if keys.get("temper") == 1.0 else ()), dataset=KEYPOINTS)

    body: Body
    sigma_px: float = 4.0
    nu: float = 4.0
    temper: float = 0.3
    which: Sequence[str] | None = None
    loss: str = "geman_mcclure"
    scale: float = 1.5

    def __post_init__(self) -> None:
        check("keypoints", POSITIVE, sigma_px=self.sigma_px, nu=self.nu, scale=self.scale)
        check("keypoints", TEMPER, temper=self.temper)
        check_choice("keypoints", tuple(LOSSES), loss=self.loss)

    @property
    def observables(self) -> Observables:
        """Keypoints of some cameras, with the deviation sigma_px."""
        return Observables(sigma_px=self.sigma_px, which=None if self.which is None else tuple(self.which))

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.scale)

    def residual(self, observed: Observed) -> ResidualFunction:
        """Of the frame's keypoints in the cameras that count, whitened by sigma_px and their weights."""
        seen = [one for one in observed.keypoints if self.which is None or one.camera.name in self.which]
        own = [keypoint_residual(self.body.skeleton, one.camera, one.joints, one.marks, self.sigma_px) for one in seen]
        return stacked(own)

    def look(self, previous: Frame | None, frame: Frame) -> PoseLook:
        """Pick out the joints that were found; poses are all equally likely where there are none."""
        seen = [found for view in self._views(frame) if len((found := self._seen(view)).joints)]
        notes = () if seen else (f"frame {frame.index}: there are no keypoints",)
        return PoseLook("keypoints", partial(self._log_prob, seen), lambda expected_pose: self, notes)

    def _seen(self, view: View) -> SeenJoints:
        order = np.array([self.body.skeleton.joint(name) for name in JOINT_NAMES])
        given = np.full((len(order), 3), np.nan) if view.keypoints is None else view.keypoints
        rows = np.flatnonzero(np.isfinite(given).all(axis=1) & (given[:, 2] > 0.0))
        return SeenJoints(view.camera, order[rows], given[rows])

    def _log_prob(self, seen: Sequence[SeenJoints], pose: FloatArray) -> FloatArray:
        log_prob, places = np.zeros(len(pose)), joints(self.body.skeleton, pose)
        for view in seen:
            apart = view.camera.project(places[:, view.joints]) - view.marks[:, :2]
            squares = view.marks[:, 2] * (apart**2).sum(axis=2) / (self.nu * self.sigma_px**2)
            found = -self.temper * (0.5 * self.nu + 1.0) * np.log1p(squares).sum(axis=1)
            log_prob += np.nan_to_num(found, nan=-np.inf, neginf=-np.inf)
        return log_prob

    def _views(self, frame: Frame) -> tuple[View, ...]:
        if self.which is None:
            return frame.views
        if unknown := set(self.which) - {view.camera.name for view in frame.views}:
            there = ", ".join(view.camera.name for view in frame.views)
            raise InputError(f"keypoints: which: no camera {min(unknown)!r}, expected some of {there}")
        return tuple(view for view in frame.views if view.camera.name in self.which)
