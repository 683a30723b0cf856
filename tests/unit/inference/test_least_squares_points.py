"""Least squares on points of the surface: accuracy against known motion, and what it says of points it cannot use."""

from dataclasses import replace

import numpy as np
import pytest
from least_squares_scenes import PriorStub, SineModel

from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import person_surface
from workbench.core.frame import Frame, View
from workbench.core.prior import Smoothness
from workbench.core.residual import surface_residual
from workbench.inference.least_squares.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion_fit import MotionFit
from workbench.inference.least_squares.single_frame import MotionDecoder
from workbench.inference.least_squares.smooth_fit import SmoothFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.likelihoods.uniform import Uniform
from workbench.utils.errors import InputError

BODY, T = person(from_height(1.75)), 10
SURFACE = person_surface(BODY)
SIDE = np.array([0.0, -1.0, 0.0])  # where the camera stands


def truth(rate_hz=1.1):
    """Poses (T, 25) of a walk along x at 14 Hz."""
    decoder = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(25))
    times = np.arange(T) / 14.0
    roots = np.array([0.0, 0.0, 0.95, 0.0, 0.05, 0.0]) + times[:, None] * np.array([1.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    return decoder.poses(decoder.states(np.array([0.5, -0.5]), 0.3 + rate_hz * times, roots))


def seen(pose, rng, n=400, sigma_m=0.02, outliers=0.15):
    """Points (n, 3) on the side of the ellipsoids towards the camera, on the skin, with noise in depth and outliers."""
    frames = forward(BODY.skeleton, pose[None])
    sizes = np.sort(SURFACE.half_sizes, axis=1)[:, 1:].prod(axis=1)
    chosen = rng.choice(len(SURFACE), size=6 * n, p=sizes / sizes.sum())
    unit = rng.standard_normal((6 * n, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    rotations = frames.rotations[0][SURFACE.joints[chosen]]
    axes = rotations @ SURFACE.axes[chosen]
    centres = frames.positions[0][SURFACE.joints[chosen]] + np.einsum("kij,kj->ki", rotations, SURFACE.centers[chosen])
    points = centres + np.einsum("kij,kj->ki", axes, unit * SURFACE.half_sizes[chosen])
    # neighbours in a chain overlap: what lies inside one of them is not on the skin
    facing = np.einsum("kij,kj->ki", axes, unit / SURFACE.half_sizes[chosen]) @ SIDE > 0.0
    off = np.abs(surface_residual(BODY.skeleton, SURFACE, points, "distance", 1.0)(pose)[0])
    points = points[facing & (off < 0.01)][:n]
    points = points + sigma_m * rng.standard_normal((len(points), 1)) * SIDE
    wrong = rng.random(len(points)) < outliers
    points[wrong] = pose[:3] + rng.uniform(-1.0, 1.0, (wrong.sum(), 3))
    return points


def frames(poses, seed=0, **noise):
    rng = np.random.default_rng(seed)
    return [Frame(5 + t, t / 14.0, (), points=seen(pose, rng, **noise)) for t, pose in enumerate(poses)]


def streams():
    return {name: np.random.default_rng(k) for k, name in enumerate(("start", "prior"))}


def error_mm(poses, truth):
    return 1e3 * np.linalg.norm(joints(BODY.skeleton, poses) - joints(BODY.skeleton, truth), axis=2).mean()


def run(inference, shown, start=None):
    return list(inference.run(shown, start, streams()))


def fitting(problem=None, likelihood=None, model=True, **given):
    likelihood = SurfacePoints(BODY) if likelihood is None else likelihood
    prior = PriorStub(motion=SineModel()) if model else None
    return LeastSquares(BODY, likelihood, prior, problem=problem, **given)


FIELD = SurfacePoints(BODY, residual="field", sigma=0.5, loss_scale=0.5)


@pytest.mark.parametrize(
    ("problem", "likelihood"),
    [(MotionFit(), None), (MotionFit(None), None), (MotionFit(4), None), (None, FIELD)],
    ids=["frame", "steady", "groups", "field"],
)
def test_a_walk_is_found_in_points_without_a_start(problem, likelihood):
    poses = truth()
    steps = run(fitting(problem, likelihood, n_particles=50), frames(poses))
    # the points lie within 1 cm of the skin before noise, and 400 of them average a noise of 2 cm to millimetres
    assert error_mm(np.array([step.expected_pose for step in steps]), poses) < 15.0
    assert [step.frame.index for step in steps] == list(range(5, 15))
    assert all(step.warnings == () for step in steps)
    assert all(0.5 < step.diagnostics["inlier_fraction"] < 0.95 for step in steps)


def test_a_fit_is_unsure_of_what_points_share_however_many_there_are():
    poses = truth()

    def fitted(common_bias_std_m, problem=None, n=400):
        inference = fitting(problem, SurfacePoints(BODY, common_bias_std_m=common_bias_std_m))
        return inference.fit_frames(frames(poses, n=n), None, np.random.default_rng(0))[0]

    def root_mm(fit):
        return 1e3 * np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2)[:, :3])

    alone, shared, plain = fitted(0.0), fitted(0.01), fitted(0.01, MotionFit(discrepancy=False))
    np.testing.assert_array_equal(shared.poses, alone.poses)
    np.testing.assert_array_equal(plain.covariance, alone.covariance)
    assert root_mm(alone).max() < 10.0 < root_mm(shared).min()  # all points are off by 10 mm
    assert root_mm(fitted(0.01, n=1600)).min() > 10.0


def test_given_ends_of_the_phase_are_used():
    poses = truth()
    start = poses[0] + 0.03
    phases = (0.3, 0.3 + 1.1 * 9 / 14)
    steps = run(fitting(MotionFit(None, phases)), frames(poses), start)
    assert error_mm(np.array([step.expected_pose for step in steps]), poses) < 15.0
    wrong = (0.8, 0.8 + 1.1 * 9 / 14)
    steps = run(fitting(MotionFit(None), phase_ends=wrong), frames(poses), start)
    assert error_mm(np.array([step.expected_pose for step in steps]), poses) > 40.0  # half a cycle off: the other leg


def test_squares_do_not_stand_outliers_that_a_redescending_loss_ignores():
    poses = truth()
    errors = {
        loss: error_mm(np.array([step.expected_pose for step in run(fitting(likelihood=SurfacePoints(BODY, loss=loss)),
                       frames(poses))]), poses)
        for loss in ("squared", "huber", "geman_mcclure")
    }  # fmt: skip
    assert errors["geman_mcclure"] < errors["huber"] < errors["squared"]


def test_without_a_model_the_walk_is_tracked_from_the_true_start():
    poses = truth()
    inference = fitting(FrameByFrame(), model=False, n_particles=10)
    steps = run(inference, frames(poses[:2], outliers=0.0, sigma_m=0.0), poses[0])
    assert error_mm(steps[0].expected_pose[None], poses[:1]) < 15.0
    assert steps[0].space.names == BODY.skeleton.dof_names
    prior = fitting(FrameByFrame(pose_prior=True), n_particles=10)
    steps = run(prior, frames(poses), poses[0])
    assert np.abs(np.array([step.expected_pose for step in steps])[:, 6:]).max() < np.pi


def test_frames_it_cannot_use_are_bridged_and_named():
    poses = truth()
    shown = frames(poses)
    broken = shown[6].points.copy()
    broken[::10] = np.nan
    shown[6] = Frame(11, shown[6].time_s, (), points=broken)
    shown[3] = Frame(8, shown[3].time_s, ())
    shown[7] = Frame(12, shown[7].time_s, (), points=np.full((30, 3), np.nan))
    shown[8] = Frame(13, shown[8].time_s, (), points=np.repeat(shown[8].points, 3000, axis=0))  # over a million
    shown[9] = Frame(14, shown[9].time_s, (), points=np.random.default_rng(9).uniform(-3.0, 3.0, (400, 3)))
    steps = run(fitting(), shown)
    said = [" / ".join(step.warnings) for step in steps]
    assert [k for k, sentences in enumerate(said) if sentences] == [3, 6, 7, 8, 9]
    assert "frame 8: no points" in said[3]
    assert f"frame 11: {len(broken[::10])} points are not finite" in said[6]
    assert "30 points are not finite" in said[7]
    assert "no points" in said[7]
    assert "points, subsampled to 1000" in said[8]
    assert "of the points lie near the body" in said[9]
    assert error_mm(np.array([step.expected_pose for step in steps[:9]]), poses[:9]) < 20.0


def test_without_a_choice_the_prior_says_which_problem():
    assert fitting().problem == MotionFit()
    assert fitting().space.names[:3] == ("a1", "a2", "phase")
    assert fitting(model=False).problem == SmoothFit()
    assert fitting(model=False).space.names == BODY.skeleton.dof_names
    stiff = Smoothness(phase=0.005)
    assert LeastSquares(BODY, SurfacePoints(BODY), PriorStub(smoothness=stiff)).smoothness is stiff
    assert fitting().smoothness == Smoothness()


def test_points_and_keypoints_are_fitted_together_by_their_product():
    """Seen from the side, points alone leave the far limbs open, which keypoints of that camera show."""
    poses = truth()[:4]
    camera = plain_camera(640, 480, 700.0, (0.3, -5.0, 1.2), (0.3, 0.0, 1.0))
    pixels = camera.project(joints(BODY.skeleton, poses))
    marks = np.concatenate([pixels, np.ones((4, 15, 1))], axis=2)
    image = np.zeros((480, 640), np.uint8)
    shown = [
        replace(frame, views=(View(camera, image, rows),))
        for frame, rows in zip(frames(poses, n=60), marks, strict=True)
    ]
    terms = {"points": SurfacePoints(BODY), "keypoints": KeypointLikelihood(BODY)}
    together = Product(terms, {"points": 1.0, "keypoints": 1.0})
    errors = [
        error_mm(np.array([step.expected_pose for step in run(fitting(MotionFit(None), one), shown, poses[0])]), poses)
        for one in (together, terms["points"])
    ]
    assert errors[0] < 15.0
    assert errors[0] < errors[1]


def test_a_product_with_a_term_without_residuals_is_refused():
    with pytest.raises(InputError, match="least squares needs residuals of every term of a product, colour has none"):
        fitting(
            likelihood=Product({"points": SurfacePoints(BODY), "colour": Uniform()}, {"points": 1.0, "colour": 0.5})
        )


def test_points_that_the_likelihood_does_not_look_at_are_not_fitted():
    shown = frames(truth()[:2])
    inference = fitting(FrameByFrame(), KeypointLikelihood(BODY), max_points=1)
    with pytest.raises(InputError, match="expected keypoints to fit, found none in 2 frames"):
        run(inference, shown, truth()[0])


def test_what_is_out_of_range_is_an_error():
    with pytest.raises(InputError, match="max_points must be positive"):
        fitting(max_points=0)
    with pytest.raises(InputError, match="frames_per_style must be above zero"):
        MotionFit(0)
    for problem in (MotionFit(), FrameByFrame(pose_prior=True)):
        with pytest.raises(InputError, match="needs a motion model"):
            fitting(problem, model=False)
    with pytest.raises(InputError, match=r"expected a likelihood with residuals.*found Uniform"):
        fitting(likelihood=Uniform())
    with pytest.raises(InputError, match="at least one frame"):
        run(fitting(), [])
    with pytest.raises(InputError, match="expected points to fit, found none in 2 frames"):
        run(fitting(), [Frame(0, 0.0, ()), Frame(1, 0.1, (), points=np.empty((0, 3)))])
