"""How well a body's surface explains observed points: the likelihood of paper D's data for a particle filter."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.body.surface import Surface, attach, person_surface, residuals
from workbench.datasets.frame import Frame
from workbench.errors import InputError


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points lie about the surface, or anywhere (paper D has the plain sum of squares, which knows no outliers):

        log p = temper · Σ_k log((1 − ε) N(r_k; 0, σ²) + ε / range_m)

    with r_k the distance of point k to the nearest part of the body's implicit surface. sigma: σ, m. epsilon: ε, the
    share of outliers. range_m: over which an outlier may lie, m. temper: below 1 flattens the posterior, since points
    of one stereo pair err together and N particles cannot follow a posterior that is much narrower than their spread.
    The previous pose and frame do not matter. Raises InputError when a constant is out of range.
    """

    body: Body
    sigma: float = 0.02
    epsilon: float = 0.15
    range_m: float = 2.0
    temper: float = 0.03
    _notes: list[str] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("sigma", self.sigma > 0.0, "positive"),
            ("epsilon", 0.0 < self.epsilon < 1.0, "between 0 and 1"),
            ("range_m", self.range_m > 0.0, "positive"),
            ("temper", 0.0 < self.temper <= 1.0, "above 0 and at most 1"),
        ):
            if not good:
                raise InputError(f"surface points: {name} must be {expected}, found {getattr(self, name)!r}")

    @cached_property
    def surface(self) -> Surface:
        """The body's implicit surface."""
        return person_surface(self.body)

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P); −inf where one is not finite, 0 for all in a frame without points."""
        given = np.empty((0, 3)) if frame.points is None else frame.points
        points = given[np.isfinite(given).all(axis=1)]
        if not len(given):
            self._notes.append(f"frame {frame.index}: there are no points")
        elif lost := len(given) - len(points):
            self._notes.append(f"frame {frame.index}: {lost} of {len(given)} points are not finite; left out")
        finite = np.isfinite(pose).all(axis=1)
        log_prob = np.full(len(pose), -np.inf)
        frames = forward(self.body.skeleton, pose[finite])
        log_prob[finite] = [
            self._one(JointFrames(frames.rotations[i : i + 1], frames.positions[i : i + 1]), one, points)
            for i, one in enumerate(pose[finite])
        ]
        return log_prob

    def warnings(self) -> tuple[str, ...]:
        """What was left out since the last call."""
        sentences = tuple(dict.fromkeys(self._notes))
        self._notes.clear()
        return sentences

    def _one(self, frames: JointFrames, pose: FloatArray, points: FloatArray) -> float:
        attachment = attach(self.surface, frames, points, "distance")
        apart = residuals(self.body.skeleton, self.surface, pose, points, "distance", attachment) / self.sigma
        near = (1.0 - self.epsilon) * np.exp(-0.5 * apart**2) / (np.sqrt(2.0 * np.pi) * self.sigma)
        return self.temper * float(np.log(near + self.epsilon / self.range_m).sum())
