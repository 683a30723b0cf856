"""How well a pose explains the 2-D joints that a detector found, or somebody marked, in every view."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.frame import Frame, View
from workbench.errors import InputError


@dataclass(frozen=True, eq=False)
class KeypointLikelihood:
    """Joints lie about where they were found, under Student's distribution in the plane, all views together:

        log p = −temper · Σ_v Σ_j (ν / 2 + 1) log(1 + w_j |u_j − û_j|² / (ν σ²))

    with û_j the joint of the pose in the image and w_j its mark's weight, a detector's confidence; up to a constant.
    sigma_px: σ, px of the images used. nu: ν degrees of freedom; few have heavy tails, as detectors, which now and
    then take one joint for another, do. temper: below 1 flattens the posterior, since a detector errs alike in frames
    that follow each other and N particles cannot follow one much narrower than their spread. A joint behind the camera
    is impossible. which: names of the cameras whose joints count, None for all. Images and the previous pose and frame
    do not matter. Raises InputError for numbers out of range and, when it first looks, a camera that is not there.
    """

    body: Body
    sigma_px: float = 4.0
    nu: float = 4.0
    temper: float = 0.3
    which: Sequence[str] | None = None
    _notes: list[str] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("sigma_px", 0.0 < self.sigma_px < np.inf, "positive"),
            ("nu", 0.0 < self.nu < np.inf, "positive"),
            ("temper", 0.0 < self.temper <= 1.0, "above 0 and at most 1"),
        ):
            if not good:
                raise InputError(f"keypoints: {name} must be {expected}, found {getattr(self, name)!r}")

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P); −inf where one is not finite, 0 in a frame without keypoints."""
        finite = np.isfinite(pose).all(axis=1)
        log_prob, n_seen = np.where(finite, 0.0, -np.inf), 0
        places = joints(self.body.skeleton, pose[finite])
        order = [self.body.skeleton.joint(name) for name in JOINT_NAMES]
        for view in self._views(frame):
            given = np.full((len(order), 3), np.nan) if view.keypoints is None else view.keypoints
            rows = np.flatnonzero(np.isfinite(given).all(axis=1) & (given[:, 2] > 0.0))
            apart = view.camera.project(places[:, np.take(order, rows)]) - given[rows, :2]
            squares = given[rows, 2] * (apart**2).sum(axis=2) / (self.nu * self.sigma_px**2)
            found = -self.temper * (0.5 * self.nu + 1.0) * np.log1p(squares).sum(axis=1)
            log_prob[finite] += np.nan_to_num(found, nan=-np.inf, neginf=-np.inf)
            n_seen += len(rows)
        if not n_seen:
            self._notes.append(f"frame {frame.index}: there are no keypoints")
        return log_prob

    def _views(self, frame: Frame) -> tuple[View, ...]:
        if self.which is None:
            return frame.views
        if unknown := set(self.which) - {view.camera.name for view in frame.views}:
            there = ", ".join(view.camera.name for view in frame.views)
            raise InputError(f"keypoints: which: no camera {min(unknown)!r}, expected some of {there}")
        return tuple(view for view in frame.views if view.camera.name in self.which)

    def warnings(self) -> tuple[str, ...]:
        """What was left out since the last call."""
        sentences = tuple(dict.fromkeys(self._notes))
        self._notes.clear()
        return sentences
