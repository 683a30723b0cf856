"""A small walker whose motion has a closed form, for the tests of least squares."""

import numpy as np

from tests.oracles.smooth_poses import joint_residual
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.prior import PriorCapabilities
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder

X, Y, Z = np.eye(3)
_JOINTS = (  # name, parent, offset in the parent's frame, m
    ("pelvis", -1, (0, 0, 0)), ("head", 0, (0.02, 0, 0.7)),
    ("left_hip", 0, (0, 0.1, 0)), ("left_knee", 2, (0, 0, -0.42)), ("left_ankle", 3, (0, 0, -0.4)),
    ("right_hip", 0, (0, -0.1, 0)), ("right_knee", 5, (0, 0, -0.42)), ("right_ankle", 6, (0, 0, -0.4)),
)  # fmt: skip
_DOFS = (
    ("root_x", 0, X), ("root_y", 0, Y), ("root_z", 0, Z), ("root_heading", 0, Z), ("root_pitch", 0, Y),
    ("root_roll", 0, X), ("left_hip_flexion", 2, -Y), ("left_knee_flexion", 3, Y), ("right_hip_flexion", 5, -Y),
    ("right_knee_flexion", 6, Y),
)  # fmt: skip
WALKER = Skeleton(
    names=tuple(row[0] for row in _JOINTS),
    parents=np.array([row[1] for row in _JOINTS]),
    offsets=np.array([row[2] for row in _JOINTS], dtype=np.float64),
    dof_names=tuple(row[0] for row in _DOFS),
    dof_joints=np.array([row[1] for row in _DOFS]),
    dof_axes=np.array([row[2] for row in _DOFS]),
    limits=np.array([(-10.0, 10.0)] * len(_DOFS)),
)
EVERY_JOINT = np.arange(len(_JOINTS))


class PriorStub:
    """A prior with capabilities only, as least squares uses it."""

    def __init__(self, **capabilities):
        self.capabilities = PriorCapabilities(**capabilities)


class SineModel:
    """Θ₀ and two components of hips and knees, sums of sines of the phase; the right leg lags by half a cycle."""

    angles = WALKER.dof_names[6:]
    scales = np.ones(2)
    scores = np.array([[-1.0, 0.0], [1.0, 0.5], [0.0, -0.5]])
    activities = ("walk", "walk", "walk")
    cycle_rate_hz = np.array([0.9, 1.0, 1.1])

    def _curves(self, mu, derivative):
        """Return the mean and the components (..., 3, 4), Σ_k a_k sin(2πk μ + φ_k) + const."""
        mu = np.asarray(mu)[..., None]
        leg = np.concatenate([mu, mu, mu + 0.5, mu + 0.5], axis=-1)
        knee = np.array([0.0, 1.0, 0.0, 1.0])
        hip = 1.0 - knee

        def wave(k, phase):
            turn = 2.0 * np.pi * (k * leg + phase)
            return 2.0 * np.pi * k * np.cos(turn) if derivative else np.sin(turn)

        constant = 0.0 if derivative else 1.0
        mean = hip * (0.15 * constant + 0.45 * wave(1, 0.25)) + knee * (0.5 * constant + 0.4 * wave(1, 0.9))
        first = 0.1 * hip * wave(1, 0.25) + 0.1 * knee * wave(2, 0.4)
        second = 0.05 * constant * np.ones_like(leg) + 0.08 * knee * wave(1, 0.1)
        return np.stack([mean, first, second], axis=-2)

    def angles_at(self, alpha, mu):
        curves = self._curves(mu, derivative=False)
        return curves[..., 0, :] + np.einsum("...d,...dc->...c", alpha, curves[..., 1:, :])

    def jacobian_at(self, alpha, mu):
        slopes = self._curves(mu, derivative=True)
        by_mu = slopes[..., 0, :] + np.einsum("...d,...dc->...c", alpha, slopes[..., 1:, :])
        return np.swapaxes(self._curves(mu, derivative=False)[..., 1:, :], -1, -2), by_mu


def decoder(start=None):
    return MotionDecoder(WALKER, SineModel(), np.zeros(10) if start is None else start)


def walk(n_frames, rate_hz=1.0, phase=0.1, alpha=(0.7, -0.4)):
    """Return times (T,) at 14 Hz and true states (T, 9) of a steady walk with a slowly changing heading."""
    times = np.arange(n_frames) / 14.0
    roots = np.array([1.0, 2.0, 0.9, 0.3, 0.05, -0.02]) + times[:, None] * np.array([1.2, 0.4, 0.0, 0.1, 0.0, 0.0])
    return times, decoder().states(np.array(alpha), phase + rate_hz * times, roots)


def joint_residuals(states, sigma_m=0.01, noise_m=0.0, outliers=0.0, removed=False, seed=0):
    """Return residual functions of all joints of the true states, with noise.

    A fraction `outliers` of the joints is 0.3 to 1 m away; with `removed` these joints are left out.
    """
    rng, outlier_rng = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    points = joints(WALKER, decoder().poses(states))
    points = points + noise_m * rng.standard_normal(points.shape)
    offsets = outlier_rng.uniform(0.3, 1.0, points.shape) * outlier_rng.choice([-1.0, 1.0], points.shape)
    wrong = outlier_rng.random(points.shape[:2]) < outliers
    points[wrong] += offsets[wrong]
    used = ~wrong if removed else np.ones_like(wrong)
    return [
        joint_residual(WALKER, EVERY_JOINT[mask], rows[mask], sigma_m) for rows, mask in zip(points, used, strict=True)
    ]


def disturbed(states, seed=1):
    """Return a start with errors of 3 cm, 0.05 rad and 0.1 cycles and mean coefficients."""
    rng = np.random.default_rng(seed)
    start = states + rng.standard_normal(states.shape) * np.array([0.0, 0.0, 0.0, *[0.03] * 3, *[0.05] * 3])
    start[:, :2] = 0.0
    start[:, 2] += 0.1
    return start
