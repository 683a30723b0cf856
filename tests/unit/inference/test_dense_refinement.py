"""Dense refinement finds the joint mode of prior, points and layers, and takes no step for uninformative layers."""

import numpy as np
import pytest
from stub_likelihoods import StubFrameLikelihood

from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.dense_refinement import refine_pose
from workbench.inference.ekf.levenberg_marquardt import heavy_tailed_prior

D, JOINTS = 5, np.ones(3, dtype=np.bool_)
WIDE = np.tile([-10.0, 10.0], (D, 1))


class Image(StubFrameLikelihood):
    """Gaussian points with mean `points` and a precision matrix; Gaussian layers with mean `layers` and a precision."""

    def __init__(self, points, precision, layers, layer_precision):
        self.points, self.precision, self.layers, self.layer_precision = points, precision, layers, layer_precision
        self.n_compared = 0

    def derivatives(self, pose, level, derive=True):
        assert level == 1
        deviation = pose - self.points
        gradient = -self.precision @ deviation
        return Derivatives(0.5 * float(deviation @ gradient), gradient, self.precision)

    def compare(self, poses, moved):
        assert moved is JOINTS
        self.n_compared += len(poses)
        return -0.5 * self.layer_precision * ((poses - self.layers) ** 2).sum(axis=1)


def scene(seed, layer_precision, n_unobserved=0):
    """Return an image, a prior, the mode of prior and points, their precision and the directions without information.

    Relative to the prior, the points have precision 100, or 0.01 in the first `n_unobserved` of their directions.
    """
    rng = np.random.default_rng(seed)
    root, directions = rng.standard_normal((2, D, D)) / np.sqrt(D)
    covariance = root @ root.T + 0.1 * np.eye(D)
    axes = np.linalg.inv(np.linalg.cholesky(covariance)).T @ np.linalg.qr(directions)[0]
    precision = (axes * np.repeat([0.01, 100.0], [n_unobserved, D - n_unobserved])) @ axes.T
    mean, points, layers = 0.3 * rng.standard_normal((3, D))
    prior = heavy_tailed_prior(mean, covariance, np.zeros(D, dtype=np.int64), 1e-300)  # practically Gaussian
    image = Image(points, precision, layers, layer_precision)
    assert isinstance(image, DenseLikelihood)
    total = np.linalg.inv(covariance) + precision
    start = np.linalg.solve(total, np.linalg.solve(covariance, mean) + precision @ points)
    return image, prior, start, total, axes[:, :n_unobserved]


def refined(image, prior, start, limits=WIDE):
    return refine_pose(image, prior, start, image.derivatives(start, 1), limits, JOINTS)


@pytest.mark.parametrize("seed", range(5))
def test_the_result_is_the_mode_of_three_gaussians(seed):
    image, prior, start, precision, _ = scene(seed, 500.0)
    pose, derivatives, count = refined(image, prior, start)
    joint_precision = precision + 500.0 * np.eye(D)
    mode = np.linalg.solve(joint_precision, precision @ start + 500.0 * image.layers)

    def cost(pose):
        return 0.5 * (pose - mode) @ joint_precision @ (pose - mode)

    assert cost(pose) < 0.02 * cost(start)  # the layers' curvature is taken to be diagonal along the axes
    assert derivatives.log_prob == image.derivatives(pose, 1).log_prob
    assert count == image.n_compared


@pytest.mark.parametrize("seed", range(5))
def test_directions_without_information_from_points_are_not_searched(seed):
    image, prior, start, _, unobserved = scene(seed, 500.0, n_unobserved=2)
    pose, _, count = refined(image, prior, start)
    change = np.abs(pose - start).max()
    np.testing.assert_allclose(unobserved.T @ (pose - start), 0.0, atol=1e-6 * change)
    assert change > 0.01
    assert count == image.n_compared


def test_uninformative_layers_leave_the_mode_of_the_points():
    image, prior, start, *_ = scene(0, 0.0)
    np.testing.assert_array_equal(refined(image, prior, start)[0], start)


def test_the_result_is_within_the_limits():
    image, prior, start, *_ = scene(1, 500.0)
    limits = np.stack([start - 0.01, start + 0.01], axis=1)
    pose, _, _ = refined(image, prior, start, limits)
    assert (pose >= limits[:, 0]).all()
    assert (pose <= limits[:, 1]).all()
    assert (pose != start).any()
