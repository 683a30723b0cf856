"""The likelihood of points on a body's surface, against the formula worked out point by point."""

import numpy as np
import pytest
from likelihood_scenes import log_prob, notes

from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import attach, person_surface, residuals
from workbench.core.frame import Frame
from workbench.likelihoods.surface_points import SurfacePoints

BODY = person(from_height(1.75))


def poses(n, spread=0.1, seed=0):
    return spread * np.random.default_rng(seed).standard_normal((n, 25))


def frame(points):
    return Frame(1, 0.1, (), points=points)


def points_on(pose, n=50, seed=1):
    """Points within a few centimetres of limbs: limbs' axes, moved at random."""
    frames = forward(BODY.skeleton, pose[None])
    rng = np.random.default_rng(seed)
    return frames.positions[0][rng.integers(15, size=n)] + 0.08 * rng.standard_normal((n, 3))


def test_it_is_the_mixture_of_every_points_distance():
    some, points = poses(4), points_on(poses(1)[0])
    likelihood = SurfacePoints(BODY, sigma=0.03, outlier_fraction=0.2, likelihood_power=0.4)
    found = log_prob(likelihood, frame(None), frame(points), some, some)
    surface = person_surface(BODY)
    for pose, value in zip(some, found, strict=True):
        parts = attach(surface, forward(BODY.skeleton, pose[None]), points)
        away = residuals(BODY.skeleton, surface, pose, points, "distance", parts)
        density = 0.8 * np.exp(-(away**2) / (2 * 0.03**2)) / (np.sqrt(2 * np.pi) * 0.03) + 0.2 / 2.0
        assert value == pytest.approx(0.4 * np.log(density).sum(), rel=1e-12)


def test_the_pose_that_made_the_points_is_the_most_likely_of_its_neighbours():
    truth = poses(1)[0]
    surface = person_surface(BODY)
    cloud = points_on(truth, 3000)
    near = np.abs(residuals(BODY.skeleton, surface, truth, cloud, "distance",
                            attach(surface, forward(BODY.skeleton, truth[None]), cloud))) < 0.003  # fmt: skip
    on_the_skin = cloud[near]
    assert len(on_the_skin) > 50
    others = truth + 0.05 * np.random.default_rng(3).standard_normal((30, 25))
    found = log_prob(
        SurfacePoints(BODY), frame(None), frame(on_the_skin), others, np.concatenate([truth[None], others])
    )
    assert found.argmax() == 0


def test_what_is_not_finite_is_left_out_and_told():
    likelihood, points = SurfacePoints(BODY), points_on(poses(1)[0])
    bad = points.copy()
    bad[3] = np.nan
    some = poses(3)
    whole = log_prob(likelihood, frame(None), frame(np.delete(points, 3, axis=0)), some, some)
    assert notes(likelihood, frame(None), frame(points), some, some) == ()
    np.testing.assert_array_equal(log_prob(likelihood, frame(None), frame(bad), some, some), whole)
    found = notes(likelihood, frame(None), frame(bad), some, some)
    assert found == ("frame 1: 1 of 50 points are not finite; omitted",)
    some[1, 4] = np.inf
    assert log_prob(likelihood, frame(None), frame(points), some, some)[1] == -np.inf


@pytest.mark.parametrize("points", [None, np.empty((0, 3))])
def test_a_frame_without_points_says_nothing(points):
    likelihood = SurfacePoints(BODY)
    assert (log_prob(likelihood, frame(None), frame(points), poses(3), poses(3)) == 0.0).all()
    assert likelihood.prepare(None, frame(points)).notes == ("frame 1: no points",)
