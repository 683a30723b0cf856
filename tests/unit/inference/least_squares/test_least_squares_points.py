"""Least squares on points of the surface: accuracy against known motion, and warnings about unusable points."""

from dataclasses import replace

import numpy as np
import pytest
from least_squares_scenes import PriorStub, SineModel

from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import person_surface
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.core.prior import Smoothness
from workbench.core.residual import surface_residual
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.utils.errors import InputError

BODY, T = person(from_height(1.75)), 10
SURFACE = person_surface(BODY)
TO_CAMERA = np.array([0.0, -1.0, 0.0])


def truth(rate_hz=1.1):
    """Poses (T, 25) of a walk along x at 14 Hz."""
    decoder = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(25))
    times = np.arange(T) / 14.0
    roots = np.array([0.0, 0.0, 0.95, 0.0, 0.05, 0.0]) + times[:, None] * np.array([1.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    return decoder.poses(decoder.states(np.array([0.5, -0.5]), 0.3 + rate_hz * times, roots))


def visible_points(pose, rng, n=400, sigma_m=0.02, outliers=0.15):
    """Return points (n, 3) on the side of the body that faces the camera, with noise in depth and outliers."""
    frames = forward(BODY.skeleton, pose[None])
    sizes = np.sort(SURFACE.half_sizes, axis=1)[:, 1:].prod(axis=1)
    chosen = rng.choice(len(SURFACE), size=6 * n, p=sizes / sizes.sum())
    unit = rng.standard_normal((6 * n, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    rotations = frames.rotations[0][SURFACE.joints[chosen]]
    axes = rotations @ SURFACE.axes[chosen]
    centres = frames.positions[0][SURFACE.joints[chosen]] + np.einsum("kij,kj->ki", rotations, SURFACE.centers[chosen])
    points = centres + np.einsum("kij,kj->ki", axes, unit * SURFACE.half_sizes[chosen])
    # Neighbouring ellipsoids overlap: points inside one of them are not on the skin.
    facing = np.einsum("kij,kj->ki", axes, unit / SURFACE.half_sizes[chosen]) @ TO_CAMERA > 0.0
    distances = np.abs(surface_residual(BODY.skeleton, SURFACE, points, "distance", 1.0)(pose)[0])
    points = points[facing & (distances < 0.01)][:n]
    points = points + sigma_m * rng.standard_normal((len(points), 1)) * TO_CAMERA
    wrong = rng.random(len(points)) < outliers
    points[wrong] = pose[:3] + rng.uniform(-1.0, 1.0, (wrong.sum(), 3))
    return points


def frames(poses, seed=0, **noise):
    rng = np.random.default_rng(seed)
    return [Frame(5 + t, t / 14.0, (), points=visible_points(pose, rng, **noise)) for t, pose in enumerate(poses)]


def streams():
    return {name: np.random.default_rng(k) for k, name in enumerate(("start", "prior"))}


def error_mm(steps, truth):
    poses = np.array([step.expected_pose for step in steps])
    return 1e3 * np.linalg.norm(joints(BODY.skeleton, poses) - joints(BODY.skeleton, truth), axis=2).mean()


def run(inference, sequence, start=None):
    return list(inference.run(sequence, start, streams()))


def least_squares(problem=None, likelihood=None, model=True, **options):
    likelihood = SurfacePoints(BODY) if likelihood is None else likelihood
    prior = PriorStub(motion=SineModel()) if model else None
    return LeastSquares(BODY, likelihood, prior, problem=problem, **options)


FIELD = SurfacePoints(BODY, residual="field", sigma=0.5, loss_scale=0.5)


@pytest.mark.parametrize(
    ("problem", "likelihood"),
    [(MotionFit(), None), (MotionFit(None), None), (MotionFit(4), None), (None, FIELD)],
    ids=["frame", "steady", "groups", "field"],
)
def test_a_walk_is_fitted_to_points_without_an_initial_pose(problem, likelihood):
    poses = truth()
    steps = run(least_squares(problem, likelihood, n_particles=50), frames(poses))
    # The points lie within 1 cm of the skin before noise; 400 of them average a noise of 2 cm to millimetres.
    assert error_mm(steps, poses) < 15.0
    assert [step.frame.index for step in steps] == list(range(5, 15))
    assert all(step.warnings == () for step in steps)
    assert all(0.5 < step.diagnostics["inlier_fraction"] < 0.95 for step in steps)


def test_a_common_bias_of_the_points_widens_the_root_whatever_their_number():
    poses = truth()

    def fitted(common_bias_std_m, problem=None, n=400):
        inference = least_squares(problem, SurfacePoints(BODY, common_bias_std_m=common_bias_std_m))
        return inference.fit_frames(frames(poses, n=n), None, np.random.default_rng(0))[0]

    def root_mm(fit):
        return 1e3 * np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2)[:, :3])

    alone, shared, plain = fitted(0.0), fitted(0.01), fitted(0.01, MotionFit(discrepancy=False))
    np.testing.assert_array_equal(shared.poses, alone.poses)
    np.testing.assert_array_equal(plain.covariance, alone.covariance)
    assert root_mm(alone).max() < 10.0 < root_mm(shared).min()  # the bias has a deviation of 10 mm
    assert root_mm(fitted(0.01, n=1600)).min() > 10.0


def test_the_phases_of_the_ends_determine_the_leg():
    poses, start, ends = truth(), truth()[0] + 0.03, np.array([0.3, 0.3 + 1.1 * 9 / 14])
    steps = run(least_squares(MotionFit(None), phase_ends=tuple(ends)), frames(poses), start)
    assert error_mm(steps, poses) < 15.0
    steps = run(least_squares(MotionFit(None), phase_ends=tuple(ends + 0.5)), frames(poses), start)
    assert error_mm(steps, poses) > 40.0  # half a cycle: the other leg


def test_robust_losses_have_smaller_errors_with_outliers():
    poses = truth()
    squared, huber, geman_mcclure = (
        error_mm(run(least_squares(likelihood=SurfacePoints(BODY, loss=loss)), frames(poses)), poses)
        for loss in ("squared", "huber", "geman_mcclure")
    )
    assert geman_mcclure < huber < squared


def test_unusable_points_are_reported_and_their_frames_interpolated():
    poses = truth()
    sequence = frames(poses)
    incomplete = sequence[6].points.copy()
    incomplete[::10] = np.nan
    points = {
        3: None,
        6: incomplete,
        7: np.full((30, 3), np.nan),
        8: np.repeat(sequence[8].points, 3000, axis=0),  # more than a million
        9: np.random.default_rng(9).uniform(-3.0, 3.0, (400, 3)),
    }
    steps = run(
        least_squares(), [replace(frame, points=points.get(t, frame.points)) for t, frame in enumerate(sequence)]
    )
    warnings = [" / ".join(step.warnings) for step in steps]
    assert [t for t, text in enumerate(warnings) if text] == list(points)
    assert "frame 8: no points" in warnings[3]
    assert f"frame 11: {len(incomplete[::10])} points are not finite" in warnings[6]
    assert "30 points are not finite" in warnings[7]
    assert "no points" in warnings[7]
    assert "points, subsampled to 1000" in warnings[8]
    assert "of the points lie near the body" in warnings[9]
    assert error_mm(steps[:9], poses[:9]) < 20.0


def test_the_prior_determines_the_default_problem():
    assert least_squares().problem == MotionFit()
    assert least_squares().space.names[:3] == ("a1", "a2", "phase")
    assert least_squares(model=False).problem == SmoothFit()
    assert least_squares(model=False).space.names == BODY.skeleton.dof_names
    smoothness = Smoothness(phase=0.005)
    assert LeastSquares(BODY, SurfacePoints(BODY), PriorStub(smoothness=smoothness)).smoothness is smoothness
    assert least_squares().smoothness == Smoothness()


def test_a_product_of_points_and_keypoints_is_more_accurate_than_points_alone():
    """Points on one side of the body do not determine the limbs on the other side, keypoints do."""
    poses = truth()[:4]
    camera = plain_camera(640, 480, 700.0, (0.3, -5.0, 1.2), (0.3, 0.0, 1.0))
    pixels = camera.project(joints(BODY.skeleton, poses))
    keypoints = np.concatenate([pixels, np.ones((4, 15, 1))], axis=2)
    image = np.zeros((480, 640), np.uint8)
    sequence = [
        replace(frame, views=(View(camera, image, rows),))
        for frame, rows in zip(frames(poses, n=60), keypoints, strict=True)
    ]
    terms = {"points": SurfacePoints(BODY), "keypoints": KeypointLikelihood(BODY)}
    both, points_only = (
        error_mm(run(least_squares(MotionFit(None), likelihood), sequence, poses[0]), poses)
        for likelihood in (Product(terms, {"points": 1.0, "keypoints": 1.0}), terms["points"])
    )
    assert both < 15.0
    assert both < points_only


def test_points_are_not_fitted_by_a_likelihood_of_keypoints():
    inference = least_squares(FrameByFrame(), KeypointLikelihood(BODY), max_points=1)
    with pytest.raises(InputError, match="expected keypoints to fit, found none in 2 frames"):
        run(inference, frames(truth()[:2]), truth()[0])


def test_invalid_options_and_empty_sequences_are_rejected():
    with pytest.raises(InputError, match="max_points must be positive"):
        least_squares(max_points=0)
    with pytest.raises(InputError, match="frames_per_style must be above zero"):
        MotionFit(0)
    with pytest.raises(InputError, match="needs a motion model"):
        least_squares(MotionFit(), model=False)
    with pytest.raises(InputError, match="at least one frame"):
        run(least_squares(), [])
    with pytest.raises(InputError, match="expected points to fit, found none in 2 frames"):
        run(least_squares(), [Frame(0, 0.0, ()), Frame(1, 0.1, (), points=np.empty((0, 3)))])
