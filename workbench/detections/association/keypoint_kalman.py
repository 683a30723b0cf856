"""Kalman filter over all joints of one person, and the likelihood of a detection given its state.

A joint's velocity is an Ornstein–Uhlenbeck process with a component common to all joints, the person's walk. The
covariance grows with the duration of a gap, and the joints' positions remain correlated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.body.skeleton import JOINT_NAMES
from workbench.core import gaussian
from workbench.detections.association.detector_view import Detection, DetectorView, J
from workbench.utils.arrays import FloatArray, IntArray

TAU_S = 0.5
"""Correlation time of velocities."""
WALKING_M_S = 1.0
"""Standard deviation, in each direction, of the velocity that all joints have in common."""
_FAST_JOINTS = {"wrist": 1.5, "elbow": 1.0, "ankle": 1.0, "knee": 0.7}
INDIVIDUAL_M_S = np.array([_FAST_JOINTS.get(name.split("_")[-1], 0.4) for name in JOINT_NAMES])
"""Standard deviation of each joint's individual velocity."""
LOG_OUTLIER = np.log(0.05)
"""Log density, 1/m², of an outlier joint: one in twenty, uniform in a square metre."""
_LOG_MISSING, _MAX_MISSING = np.log(0.01), 7
"""Log probability of an undetected joint inside the image of a detected person, and the largest number of such joints:
occlusion hides half of a person at once."""
_LOG_OTHER, _LOG_PLACE = -np.log(2.0 * np.pi * 0.3**2), -np.log(50.0)
"""Log densities of a new person's joints: 0.3 m around the position of a body that is uniform in 50 m²."""
_GATE_M = 0.3
"""Gate: detections whose mean is off by more than this and four standard deviations are another person's."""
ARMS, LEGS = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")


def exchanged(*parts: str) -> IntArray:
    """Return the order of JOINT_NAMES with left and right exchanged in these parts."""
    other = {"left": "right", "right": "left"}
    names = [name.split("_", 1) for name in JOINT_NAMES]
    swapped = [f"{other[side]}_{part[0]}" if part and part[0] in parts else "" for side, *part in names]
    return np.array([JOINT_NAMES.index(new or old) for new, old in zip(swapped, JOINT_NAMES, strict=True)])


_LABELLINGS = ((exchanged(), 0.0), (exchanged(*ARMS), -4.0), (exchanged(*LEGS), -4.0), (exchanged(*ARMS, *LEGS), -4.5))
"""Orders of a detection's joints, in which the detector may have exchanged left and right, and their log odds."""


@dataclass(frozen=True, eq=False)
class KeypointState:
    """A Gaussian. mean: (2, J, D) positions, m, and velocities, m/s. covariance: (2JD, 2JD), in the same order."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def joints(self) -> FloatArray:
        """Positions (J, D), m."""
        return self.mean[0]


def initial_state(joints: FloatArray, sigma_m: FloatArray) -> KeypointState:
    """Return the state of joints at (J, D), m, with standard deviations (J,), m, and unknown velocities."""
    dims = joints.shape[1]
    covariance = np.zeros((2, J * dims, 2, J * dims))
    covariance[0, :, 0] = np.diag(np.repeat(sigma_m**2, dims))
    covariance[1, :, 1] = _velocity_covariance(dims)
    return KeypointState(np.stack([joints, np.zeros_like(joints)]), covariance.reshape(2 * J * dims, -1))


def predict(state: KeypointState, dt_s: float) -> KeypointState:
    """Return the state predicted after `dt_s` seconds."""
    dims, decay = state.mean.shape[2], float(np.exp(-dt_s / TAU_S))
    motion = np.array([[1.0, TAU_S * (1.0 - decay)], [0.0, decay]])
    position = TAU_S**2 * (2.0 * dt_s / TAU_S - 3.0 + 4.0 * decay - decay**2)
    cross = TAU_S * (1.0 - decay) ** 2
    noise = np.kron(np.array([[position, cross], [cross, 1.0 - decay**2]]), _velocity_covariance(dims))
    transition = np.kron(motion, np.eye(J * dims))
    mean, covariance = gaussian.predict(state.mean.ravel(), state.covariance, transition, noise)
    return KeypointState(mean.reshape(state.mean.shape), covariance)


def _velocity_covariance(dims: int) -> FloatArray:
    """Return the stationary covariance (JD, JD) of velocities."""
    return np.asarray(np.kron(np.diag(INDIVIDUAL_M_S**2) + WALKING_M_S**2, np.eye(dims)), np.float64)


@dataclass(frozen=True, eq=False)
class _Match:
    """Match of a detection with a state. log_density: of its joints, 1/m² each. rows: (M,) inliers among the joints.
    residuals_m: (M, 2), of the inliers. sigma_m: (M,)."""

    log_density: float
    rows: IntArray
    residuals_m: FloatArray
    sigma_m: FloatArray


class PredictedView:
    """The distribution of a person's joints in one view, m at their distance."""

    def __init__(self, state: KeypointState, view: DetectorView) -> None:
        self._state = state
        places, jacobians, self._depth = view.project(state.joints)
        self._places, dims, self._inside = places, state.mean.shape[2], view.inside(places)
        jacobians = jacobians * self._depth[:, None, None]  # (J, 2, D), m per m
        joint_columns = state.covariance.reshape(-1, 2, J, dims)[:, 0]
        self._cross_covariance = np.einsum("skd,kld->skl", joint_columns, jacobians)  # (2JD, J, 2)
        joint_rows = self._cross_covariance.reshape(2, J, dims, J, 2)[0]
        self._covariance = np.einsum("jid,jdkl->jikl", jacobians, joint_rows)  # (J, 2, J, 2), m²

    def matches(self, detections: Sequence[Detection]) -> list[_Match]:
        """Return the best match of each detection over labellings of left and right; one without joints has log density
        -inf."""
        places = np.stack([one.places for one in detections])
        detected = np.isfinite(places[..., 0])
        n_detected = detected.sum(axis=1)
        residuals = np.where(detected[..., None], (places - self._places) * self._depth[:, None], 0.0)
        offsets = residuals.sum(axis=1) / np.maximum(n_detected, 1)[:, None]
        sigma = np.sqrt(np.diagonal(self._covariance.reshape(2 * J, -1)).max())
        is_near = (n_detected > 0) & (np.linalg.norm(offsets, axis=1) < _GATE_M + 4.0 * sigma)
        others = np.where(n_detected > 0, LOG_OUTLIER * n_detected, -np.inf)
        no_inliers = np.empty(0, dtype=np.intp), np.empty((0, 2)), np.empty(0)
        return [
            self._best_match(one) if near else _Match(float(other), *no_inliers)
            for one, near, other in zip(detections, is_near, others, strict=True)
        ]

    def _best_match(self, detection: Detection) -> _Match:
        best = self._match(detection, *_LABELLINGS[0])
        if detection.detected.sum() - len(best.rows) < 2:
            return best
        return max((best, *(self._match(detection, *one) for one in _LABELLINGS[1:])), key=lambda one: one.log_density)

    def _match(self, detection: Detection, order: IntArray, log_odds: float) -> _Match:
        places, sigma_m = detection.places[order], detection.sigma[order]
        residuals = (places - self._places) * self._depth[:, None]
        diagonal = self._covariance[np.arange(J), :, np.arange(J)] + (sigma_m**2)[:, None, None] * np.eye(2)
        with np.errstate(invalid="ignore"):
            log_densities = -0.5 * np.einsum("ji,jik,jk->j", residuals, np.linalg.inv(diagonal), residuals)
            log_densities -= 0.5 * np.linalg.slogdet(diagonal)[1] + np.log(2.0 * np.pi)
            rows = np.flatnonzero(log_densities > LOG_OUTLIER)
        n_detected = int(detection.detected.sum())
        log_density = LOG_OUTLIER * (n_detected - len(rows)) + self._log_density(rows, residuals[rows], sigma_m[rows])
        log_odds += _LOG_MISSING * min(int((detection.missing & self._inside).sum()), _MAX_MISSING)
        return _Match(max(log_density, LOG_OUTLIER * n_detected) + log_odds, rows, residuals[rows], sigma_m[rows])

    def _log_density(self, rows: IntArray, residuals_m: FloatArray, sigma_m: FloatArray) -> float:
        if not len(rows):
            return 0.0
        factor = scipy.linalg.cho_factor(self._innovation(rows, sigma_m), lower=True)
        squares = residuals_m.ravel() @ scipy.linalg.cho_solve(factor, residuals_m.ravel())
        return float(-0.5 * squares - np.log(np.diag(factor[0])).sum() - len(rows) * np.log(2.0 * np.pi))

    def _innovation(self, rows: IntArray, sigma_m: FloatArray) -> FloatArray:
        covariance = self._covariance[rows][:, :, rows].reshape(2 * len(rows), -1)
        return covariance + np.diag(np.repeat(sigma_m**2, 2))

    def updated(self, match: _Match) -> KeypointState:
        """Return the state conditioned on a detection's inliers."""
        if not len(match.rows):
            return self._state
        cross = self._cross_covariance[:, match.rows].reshape(len(self._cross_covariance), -1)
        innovation = self._innovation(match.rows, match.sigma_m)
        mean, covariance = gaussian.condition(
            self._state.mean.ravel(), self._state.covariance, cross, innovation, match.residuals_m.ravel()
        )
        return KeypointState(mean.reshape(self._state.mean.shape), covariance)


def log_other(detection: Detection) -> float:
    """Return the log density of a detection of a person who is not tracked yet."""
    return float(_LOG_OTHER * detection.detected.sum() + _LOG_PLACE)
