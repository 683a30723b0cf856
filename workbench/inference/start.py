"""The starting pose from marked 2-D joints, by least squares over the prior's own parameters."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joint_jacobian, joints
from workbench.body.skeleton import Skeleton
from workbench.errors import InputError
from workbench.priors.cyclic import Cyclic

MARK_SIGMA_PX = 4.0
UPRIGHT_SIGMA_RAD = 0.15
N_PHASES, N_HEADINGS = 8, 8


@dataclass(frozen=True, eq=False)
class StartFit:
    """pose: (P,). error_px: root mean square distance to the marks, weighted. phase, heading: where it ended."""

    pose: FloatArray
    error_px: float
    phase: float
    heading: float


def start_from_marks(prior: Cyclic, skeleton: Skeleton, camera: Camera, marks: FloatArray) -> StartFit:
    """Fit coefficients, phase, root position and rotation to marks (J, 3) [u px, v px, weight], NaN where unmarked.

    Least squares from 8 phases × 8 headings; the lowest cost wins. Residuals are whitened: pixels by 4 px over the
    mark's weight, coefficients by their learned λ, pitch and roll by 0.15 rad. Left and right come with the marks.
    Raises InputError when fewer than four joints are marked.
    """
    marked = np.flatnonzero(np.isfinite(marks).all(axis=1) & (np.nan_to_num(marks[:, 2]) > 0.0))
    if len(marked) < 4:
        raise InputError(f"start marks: expected at least 4 marked joints, found {len(marked)}")
    problem = _Problem(prior, skeleton, camera, marked, marks[marked])
    fits = [
        least_squares(problem.residual, first, jac=problem.jacobian, x_scale="jac", max_nfev=60)
        for first in problem.first_guesses()
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    state = problem.state(best.x)
    pose = prior.pose(state)[0]
    seen = camera.project(joints(skeleton, pose[None])[0, marked])
    weight = marks[marked, 2]
    error = np.sqrt((weight * ((seen - marks[marked, :2]) ** 2).sum(axis=1)).sum() / weight.sum())
    phase, heading = state[0, prior.space.slices["phase"]][0], state[0, prior.space.slices["root_rotation"]][0]
    return StartFit(pose, float(error), float(phase % 1.0), float(heading))


class _Problem:
    """Whitened residuals of the marks and of the prior, over a state without its phase speed."""

    def __init__(self, prior: Cyclic, skeleton: Skeleton, camera: Camera, marked: IntArray, marks: FloatArray):
        self.prior, self.skeleton, self.camera = prior, skeleton, camera
        self.marked, self.marks = marked, marks
        self.whitening = marks[:, 2:] / MARK_SIGMA_PX
        slices = prior.space.slices
        self.coefficients = slices["coefficients"]
        self.lean = np.arange(slices["root_rotation"].start + 1, slices["root_rotation"].stop)
        self.free = np.array([d for d in range(len(prior.space)) if d != slices["phase_speed"].start])

    def state(self, x: FloatArray) -> FloatArray:
        state = np.zeros((1, len(self.prior.space)))
        state[0, self.free] = x
        return state

    def residual(self, x: FloatArray) -> FloatArray:
        state = self.state(x)
        seen = self.camera.project(joints(self.skeleton, self.prior.pose(state))[0, self.marked])
        image = np.nan_to_num((seen - self.marks[:, :2]) * self.whitening, nan=1e3)
        return np.concatenate([image.ravel(), state[0, self.coefficients], state[0, self.lean] / UPRIGHT_SIGMA_RAD])

    def jacobian(self, x: FloatArray) -> FloatArray:
        state = self.state(x)
        pose = self.prior.pose(state)
        points = joints(self.skeleton, pose)[0, self.marked]
        moved = joint_jacobian(self.skeleton, pose)[0, self.marked] @ self.prior.pose_jacobian(state)[0]
        image = projection_jacobian(self.camera, points) @ moved * self.whitening[:, :, None]
        rows = np.eye(len(self.prior.space))
        whole = np.concatenate(
            [image.reshape(-1, rows.shape[0]), rows[self.coefficients], rows[self.lean] / UPRIGHT_SIGMA_RAD]
        )
        free: FloatArray = whole[:, self.free]
        return free

    def first_guesses(self) -> list[FloatArray]:
        """Mean coefficients at 8 phases × 8 headings, placed so that size and middle agree with the marks."""
        guesses = []
        slices = self.prior.space.slices
        for heading in np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS:
            for phase in np.arange(N_PHASES) / N_PHASES:
                state = np.zeros((1, len(self.prior.space)))
                state[0, slices["phase"]] = phase
                state[0, slices["root_rotation"].start] = heading
                state[0, slices["root_position"]] = self._place(state)
                guesses.append(state[0, self.free])
        return guesses

    def _place(self, state: FloatArray) -> FloatArray:
        body = joints(self.skeleton, self.prior.pose(state))[0, self.marked]
        middle, seen = body.mean(axis=0), self.marks[:, :2]
        camera, focal = self.camera, self.camera.matrix[1, 1]
        spread = np.linalg.norm((body - middle) @ camera.rotation[:2].T)
        depth = focal * spread / max(float(np.linalg.norm(seen - seen.mean(axis=0))), 1.0)
        ray = np.append((seen.mean(axis=0) - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], 1.0)
        place: FloatArray = camera.rotation.T @ (depth * ray - camera.translation) - middle
        return place


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Derivative (n, 2, 3), px/m, of the pixels of world points (n, 3); the lens' distortion is left out."""
    x, y, z = camera.to_camera(points).T
    zero = np.zeros_like(z)
    focal_x, focal_y = camera.matrix[0, 0], camera.matrix[1, 1]
    seen = np.array([[focal_x / z, zero, -focal_x * x / z**2], [zero, focal_y / z, -focal_y * y / z**2]])
    jacobian: FloatArray = seen.transpose(2, 0, 1) @ camera.rotation
    return jacobian
