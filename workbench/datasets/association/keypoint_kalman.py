"""Where a person's joints are believed to be, and how well a detection fits that: a Kalman filter over all joints.

A joint's velocity is an Ornstein–Uhlenbeck process, of which a part is common to all joints: the person walks. After a
gap the belief is wider, the more so the longer it was, and joints are still believed to be where the others are.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.body.skeleton import JOINT_NAMES
from workbench.core import gaussian
from workbench.datasets.association.detections import Detection, Eye, J
from workbench.utils.arrays import FloatArray, IntArray

TAU_S = 0.5
"""Time in which a joint's velocity is forgotten."""
WALKING_M_S = 1.0
"""Standard deviation of the velocity, in each direction, that all joints have in common."""
_QUICK = {"wrist": 1.5, "elbow": 1.0, "ankle": 1.0, "knee": 0.7}
OWN_M_S = np.array([_QUICK.get(name.split("_")[-1], 0.4) for name in JOINT_NAMES])
"""And of each joint's own."""

LOG_ASTRAY = np.log(0.05)
"""Log density, 1/m², of a joint that the detector puts elsewhere: one in twenty, somewhere in a square metre."""
LOG_LACKING, MOST_LACKING = np.log(0.01), 7
"""Of a joint in the image that the detector does not find in a person it finds, as far as half of them: whose other
half is hidden lacks no less. Of somebody else it may be anything."""
LOG_OTHER, LOG_PLACE = -np.log(2.0 * np.pi * 0.3**2), -np.log(50.0)
"""Log densities of somebody else's joints: about where a body's are, 0.3 m, of one who is anywhere in 50 m²."""

ARMS, LEGS = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")


def exchanged(*parts: str) -> IntArray:
    """Return the order of JOINT_NAMES with left and right exchanged in these parts."""
    other = {"left": "right", "right": "left"}
    names = [name.split("_", 1) for name in JOINT_NAMES]
    swapped = [f"{other[side]}_{part[0]}" if part and part[0] in parts else "" for side, *part in names]
    return np.array([JOINT_NAMES.index(new or old) for new, old in zip(swapped, JOINT_NAMES, strict=True)])


FAR_M = 0.3
"""Whose joints are in their middle farther off than this, and four standard deviations, is somebody else."""

LABELLINGS = ((exchanged(), 0.0), (exchanged(*ARMS), -4.0), (exchanged(*LEGS), -4.0), (exchanged(*ARMS, *LEGS), -4.5))
"""Ways to read a detection, where the detector may have taken left for right, and their log odds."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A Gaussian. mean: (2, J, D) positions, m, and velocities, m/s. covariance: (2JD, 2JD), in the same order."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def joints(self) -> FloatArray:
        """Positions (J, D), m."""
        return self.mean[0]


def born(joints: FloatArray, sigma_m: FloatArray) -> Belief:
    """Believe somebody's joints (J, D) to be there, give or take (J,) m; how they move is not known."""
    dims = joints.shape[1]
    covariance = np.zeros((2, J * dims, 2, J * dims))
    covariance[0, :, 0] = np.diag(np.repeat(sigma_m**2, dims))
    covariance[1, :, 1] = _spread(dims)
    return Belief(np.stack([joints, np.zeros_like(joints)]), covariance.reshape(2 * J * dims, -1))


def predict(belief: Belief, dt_s: float) -> Belief:
    """Move a belief on in time."""
    dims, keep = belief.mean.shape[2], float(np.exp(-dt_s / TAU_S))
    moves = np.array([[1.0, TAU_S * (1.0 - keep)], [0.0, keep]])
    place = TAU_S**2 * (2.0 * dt_s / TAU_S - 3.0 + 4.0 * keep - keep**2)
    both = TAU_S * (1.0 - keep) ** 2
    noise = np.kron(np.array([[place, both], [both, 1.0 - keep**2]]), _spread(dims))
    transition = np.kron(moves, np.eye(J * dims))
    mean, covariance = gaussian.predict(belief.mean.ravel(), belief.covariance, transition, noise)
    return Belief(mean.reshape(belief.mean.shape), covariance)


def _spread(dims: int) -> FloatArray:
    """Return the covariance (JD, JD) of velocities at rest."""
    return np.asarray(np.kron(np.diag(OWN_M_S**2) + WALKING_M_S**2, np.eye(dims)), np.float64)


@dataclass(frozen=True, eq=False)
class Match:
    """How a detection fits a belief. log_density: of its joints, 1/m² each. rows: joints (M,) that are where they were
    believed to be. off_m: (M, 2), how far they are from there. sigma_m: (M,)."""

    log_density: float
    rows: IntArray
    off_m: FloatArray
    sigma_m: FloatArray


class Expected:
    """What an eye should see of a belief."""

    def __init__(self, belief: Belief, eye: Eye) -> None:
        self._belief = belief
        places, slopes, self._per_m = eye.project(belief.joints)
        self._places, dims, self._inside = places, belief.mean.shape[2], eye.inside(places)
        self._slopes = slopes * self._per_m[:, None, None]  # (J, 2, D), m per m
        with_joints = belief.covariance.reshape(-1, 2, J, dims)[:, 0]
        self._with_state = np.einsum("skd,kld->skl", with_joints, self._slopes)  # (2JD, J, 2)
        of_places = self._with_state.reshape(2, J, dims, J, 2)[0]
        self._covariance = np.einsum("jid,jdkl->jikl", self._slopes, of_places)  # (J, 2, J, 2), m²

    def match(self, detection: Detection) -> Match:
        """Compare a detection, in the labelling that fits best; one without joints is nobody's."""
        n_found = int(detection.found.sum())
        if n_found == 0 or not self._near(detection):
            log_density = LOG_ASTRAY * n_found if n_found else -np.inf
            return Match(log_density, np.empty(0, dtype=np.intp), np.empty((0, 2)), np.empty(0))
        best = self._match(detection, *LABELLINGS[0])
        if n_found - len(best.rows) < 2:
            return best
        return max((self._match(detection, *one) for one in LABELLINGS), key=lambda match: match.log_density)

    def _near(self, detection: Detection) -> bool:
        """Tell whether it is at all worth while to compare joints: the middle of those found is where it may be."""
        found = detection.found
        off = ((detection.places - self._places) * self._per_m[:, None])[found].mean(axis=0)
        spread = np.sqrt(np.diagonal(self._covariance.reshape(2 * J, -1)).max())
        return bool(np.linalg.norm(off) < FAR_M + 4.0 * spread)

    def _match(self, detection: Detection, order: IntArray, log_odds: float) -> Match:
        places, sigma_m = detection.places[order], detection.sigma[order]
        off = (places - self._places) * self._per_m[:, None]
        diagonal = self._covariance[np.arange(J), :, np.arange(J)] + (sigma_m**2)[:, None, None] * np.eye(2)
        with np.errstate(invalid="ignore"):
            alone = -0.5 * np.einsum("ji,jik,jk->j", off, np.linalg.inv(diagonal), off)
            alone -= 0.5 * np.linalg.slogdet(diagonal)[1] + np.log(2.0 * np.pi)
            rows = np.flatnonzero(alone > LOG_ASTRAY)
        n_found = int(detection.found.sum())
        log_density = LOG_ASTRAY * (n_found - len(rows)) + self._log_density(rows, off[rows], sigma_m[rows])
        n_lacking = 0 if detection.lacks is None else int((detection.lacks & self._inside).sum())
        log_odds += LOG_LACKING * min(n_lacking, MOST_LACKING)
        return Match(max(log_density, LOG_ASTRAY * n_found) + log_odds, rows, off[rows], sigma_m[rows])

    def _log_density(self, rows: IntArray, off_m: FloatArray, sigma_m: FloatArray) -> float:
        if not len(rows):
            return 0.0
        factor = scipy.linalg.cho_factor(self._innovation(rows, sigma_m), lower=True)
        squares = off_m.ravel() @ scipy.linalg.cho_solve(factor, off_m.ravel())
        return float(-0.5 * squares - np.log(np.diag(factor[0])).sum() - len(rows) * np.log(2.0 * np.pi))

    def _innovation(self, rows: IntArray, sigma_m: FloatArray) -> FloatArray:
        covariance = self._covariance[rows][:, :, rows].reshape(2 * len(rows), -1)
        return covariance + np.diag(np.repeat(sigma_m**2, 2))

    def updated(self, match: Match) -> Belief:
        """Return the belief after the detection was seen."""
        if not len(match.rows):
            return self._belief
        cross = self._with_state[:, match.rows].reshape(len(self._with_state), -1)
        mean, covariance = gaussian.condition(
            self._belief.mean.ravel(), self._belief.covariance, cross,
            self._innovation(match.rows, match.sigma_m), match.off_m.ravel(),
        )  # fmt: skip
        return Belief(mean.reshape(self._belief.mean.shape), covariance)


def log_other(detection: Detection) -> float:
    """Return the log density of a detection of somebody who is not known yet."""
    return float(LOG_OTHER * detection.found.sum() + LOG_PLACE)
