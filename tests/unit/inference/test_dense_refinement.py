"""Dense refinement: the joint mode of prior, points and layers, and no step where layers are uninformative."""

import numpy as np
import pytest
from stub_likelihoods import StubFrameLikelihood

from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.dense_refinement import refine_pose
from workbench.inference.ekf.levenberg_marquardt import heavy_tailed_prior

D, JOINTS = 5, np.ones(3, dtype=np.bool_)
WIDE = np.tile([-10.0, 10.0], (D, 1))


class Image(StubFrameLikelihood):
    """Points are likeliest at `points`, with a precision; layers at `layers`, with `sharp` in every direction."""

    def __init__(self, points, precision, layers, sharp):
        self.points, self.precision, self.layers, self.sharp, self.asked = points, precision, layers, sharp, 0

    def derivatives(self, pose, level, derive=True):
        assert level == 1
        off = pose - self.points
        return Derivatives(-0.5 * float(off @ self.precision @ off), -self.precision @ off, self.precision)

    def compare(self, poses, moved):
        assert moved is JOINTS
        self.asked += len(poses)
        return -0.5 * self.sharp * ((poses - self.layers) ** 2).sum(axis=1)


def scene(seed, sharp, unseen=0):
    """A prior, points whose precision shares no axes with it, 100 times as sharp but in `unseen` directions."""
    rng = np.random.default_rng(seed)
    root, turned = rng.standard_normal((2, D, D)) / np.sqrt(D)
    covariance = root @ root.T + 0.1 * np.eye(D)
    own = np.linalg.inv(np.linalg.cholesky(covariance)).T @ np.linalg.qr(turned)[0]
    precision = (own * np.repeat([0.01, 100.0], [unseen, D - unseen])) @ own.T
    mean, points, layers = 0.3 * rng.standard_normal((3, D))
    prior = heavy_tailed_prior(mean, covariance, np.zeros(D, dtype=np.int64), 1e-300)  # so unlikely that it is Gaussian
    frame_likelihood = Image(points, precision, layers, sharp)
    assert isinstance(frame_likelihood, DenseLikelihood)
    alone = np.linalg.inv(covariance) + precision
    start = np.linalg.solve(alone, np.linalg.solve(covariance, mean) + precision @ points)
    return frame_likelihood, prior, start, alone, own[:, :unseen]


@pytest.mark.parametrize("seed", range(5))
def test_it_climbs_to_the_peak_of_three_gaussians(seed):
    frame_likelihood, prior, start, alone, _ = scene(seed, 500.0)
    pose, slope, count = refine_pose(
        frame_likelihood, prior, start, frame_likelihood.derivatives(start, 1), WIDE, JOINTS
    )
    expected = np.linalg.solve(alone + 500.0 * np.eye(D), alone @ start + 500.0 * frame_likelihood.layers)

    def below(place):
        off = place - expected
        return 0.5 * off @ (alone + 500.0 * np.eye(D)) @ off

    assert below(pose) < 0.02 * below(start)  # what is shared off the axes is not looked at
    assert slope.log_prob == frame_likelihood.derivatives(pose, 1).log_prob
    assert count == frame_likelihood.asked


@pytest.mark.parametrize("seed", range(5))
def test_the_layers_are_not_asked_of_what_the_points_do_not_see(seed):
    frame_likelihood, prior, start, _, unseen = scene(seed, 500.0, unseen=2)
    pose, _, count = refine_pose(frame_likelihood, prior, start, frame_likelihood.derivatives(start, 1), WIDE, JOINTS)
    moved = np.abs(pose - start).max()
    np.testing.assert_allclose(unseen.T @ (pose - start), 0.0, atol=1e-6 * moved)
    assert moved > 0.01
    assert count == frame_likelihood.asked


def test_it_stays_at_the_peak_of_the_points_where_layers_say_nothing():
    frame_likelihood, prior, start, *_ = scene(0, 0.0)
    np.testing.assert_array_equal(
        refine_pose(frame_likelihood, prior, start, frame_likelihood.derivatives(start, 1), WIDE, JOINTS)[0], start
    )


def test_it_keeps_within_limits():
    frame_likelihood, prior, start, *_ = scene(1, 500.0)
    limits = np.stack([start - 0.01, start + 0.01], axis=1)
    pose, _, _ = refine_pose(frame_likelihood, prior, start, frame_likelihood.derivatives(start, 1), limits, JOINTS)
    assert (pose >= limits[:, 0]).all()
    assert (pose <= limits[:, 1]).all()
    assert (pose != start).any()
