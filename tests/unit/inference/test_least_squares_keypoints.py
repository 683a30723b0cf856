"""Least squares on 2-D keypoints: derivatives, a walk found from nothing, what several frames tell, what is said."""

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, NOTHING, PX_M, errors_mm, frames, keypoints, streams, walk
from least_squares_scenes import PriorStub, SineModel

from workbench.core.frame import Frame
from workbench.core.observations import observe, observed_kinds
from workbench.core.residual import Loss
from workbench.inference.least_squares.all_frames import fit_problem
from workbench.inference.least_squares.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion_fit import MotionFit
from workbench.inference.least_squares.residuals import views_residual
from workbench.inference.least_squares.single_frame import FitData, MotionDecoder
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

HIDDEN_ANKLES = [BODY.skeleton.joint("left_ankle"), BODY.skeleton.joint("right_ankle")]
STEADY = MotionFit(frames_per_style=None)


def observed(shown):
    return observe(shown, BODY.skeleton, 1000, np.random.default_rng(0))[0]


def run(shown, start=None, model=True, problem=STEADY, **given):
    prior = PriorStub(motion=SineModel()) if model else None
    inference = LeastSquares(BODY, KeypointLikelihood(BODY, **given), prior, problem=problem, n_particles=20)
    return list(inference.run(shown, start, streams()))


def found(steps):
    return np.array([step.expected_pose for step in steps])


def test_the_gradient_over_frames_is_that_of_finite_differences():
    times, phases, poses = walk(4)
    shown = frames(times, keypoints(poses, sigma_px=4.0, missing=0.2))
    residuals = [views_residual(BODY.skeleton, one.keypoints, 3.0) for one in observed(shown)]
    decoder = MotionDecoder(BODY.skeleton, SineModel(), poses[0])
    problem = fit_problem(decoder, FitData(residuals, times, Loss("huber", 2.0)), 1)
    x = problem.unknowns(decoder.states(np.array([0.2, 0.1]), phases + 0.05, poses[:, :6] + 0.03))
    moves = 1e-6 * np.eye(len(x))
    exact = np.array([(problem.expand(x + move).cost - problem.expand(x - move).cost) / 2e-6 for move in moves])
    # central differences of a cost of hundreds: rounding over the step
    np.testing.assert_allclose(problem.expand(x).gradient, exact, rtol=1e-5, atol=1e-6 * np.abs(exact).max())


SLOW = [pytest.param(heading, marks=pytest.mark.slow) for heading in (0, 130, 180, 270)]


@pytest.mark.parametrize("heading_deg", [50, *SLOW])
@pytest.mark.slow
def test_a_walk_is_found_in_keypoints_from_nothing(heading_deg):
    times, phases, poses = walk(8, heading=np.radians(heading_deg))
    steps = run(frames(times, keypoints(poses, sigma_px=3.0, missing=0.1)))
    everywhere, across = errors_mm(found(steps), poses)
    # in the image a single joint's noise, of which the motion averages most; depth is known by the person's size
    assert across < 3.0 * 1e3 * PX_M
    assert everywhere < 100.0
    apart = found(steps)[:, 3] - np.radians(heading_deg)
    assert np.abs((apart + np.pi) % (2.0 * np.pi) - np.pi).max() < np.radians(20.0)
    mu = np.array([step.particles[:, 2].mean() for step in steps])
    assert np.abs((mu - phases + 0.5) % 1.0 - 0.5).max() < 0.1
    assert all(step.warnings == () for step in steps)
    assert all(step.attachment is None for step in steps)


def test_frames_between_keypoints_are_bridged_and_named():
    times, _, poses = walk(18)
    seen = [rows if t in (1, 2, 6, 10, 13, 15) else None for t, rows in enumerate(keypoints(poses, sigma_px=2.0))]
    steps = run(frames(times, seen), start=poses[0])
    said = {t: step.warnings for t, step in enumerate(steps) if step.warnings}
    assert said == {
        0: ("frame 20: no keypoints; interpolated from the frames next to it",),
        3: ("frames 23 to 25: no keypoints; interpolated from the frames next to them",),
        7: ("frames 27 to 29: no keypoints; interpolated from the frames next to them",),
        11: ("frames 31 to 32: no keypoints; interpolated from the frames next to them",),
        14: ("frame 34: no keypoints; interpolated from the frames next to it",),
        16: ("frames 36 to 37: no keypoints; interpolated from the frames next to them",),
    }
    # between two that are a third of a second apart a person is where both say, to a joint's noise or so
    between = [3, 4, 5, 7, 8, 9, 11, 12, 14]
    assert errors_mm(found(steps)[between], poses[between])[1] < 30.0
    spread = [step.poses[:, 0].std() for step in steps]  # along the image; in depth all frames are alike
    assert spread[8] > 1.2 * spread[6]


def test_several_frames_tell_what_one_leaves_open():
    # without ankles the walker's pose at μ and at −μ look the same: only the way the hips go tells which it is
    times, phases, poses = walk(6, phase=0.3)
    seen = keypoints(poses)
    seen[:, HIDDEN_ANKLES] = np.nan
    one = KeypointLikelihood(BODY, sigma_px=3.0).residual_function(observed(frames(times, seen))[0])
    decoder = MotionDecoder(BODY.skeleton, SineModel(), poses[0])
    twin = decoder.poses(decoder.states(np.array([0.5, -0.5]), -phases[:1], poses[:1, :6]))[0]
    assert np.abs(twin - poses[0]).max() > 0.1
    np.testing.assert_allclose(one(twin)[0], one(poses[0])[0], atol=1e-6)
    steps = run(frames(times, seen))
    mu = np.array([step.particles[:, 2].mean() for step in steps])
    assert np.abs((mu - phases + 0.5) % 1.0 - 0.5).max() < 0.05


def test_wrong_keypoints_do_not_matter_under_a_loss_that_redescends():
    times, phases, poses = walk()
    known = {"start": poses[0], "problem": MotionFit(phases=(phases[0], phases[-1]))}
    seen = keypoints(poses, sigma_px=2.0)
    wrong = np.random.default_rng(5).random(seen.shape[:2]) < 0.1
    seen[wrong, :2] += 80.0
    across = {
        loss: errors_mm(found(run(frames(times, seen), loss=loss, **known)), poses)[1]
        for loss in ("squared", "geman_mcclure")
    }
    assert across["geman_mcclure"] < 15.0 < across["squared"]


def test_points_and_keypoints_are_seen_together():
    times, _, poses = walk(4)
    rng = np.random.default_rng(1)
    cloud = poses[0, :3] + 0.1 * rng.standard_normal((40, 3))
    both = [Frame(frame.index, frame.time_s, frame.views, points=cloud) for frame in frames(times, keypoints(poses))]
    both[2] = Frame(22, times[2], ())
    seen, warnings = observe(both, BODY.skeleton, 1000, rng)
    assert observed_kinds(seen) == ("points", "keypoints")
    assert warnings[2] == ("frame 22: no points or keypoints; interpolated from the frames next to it",)
    alone, warnings = observe(both, BODY.skeleton, 10, rng, KeypointLikelihood(BODY).observables)
    assert observed_kinds(alone) == ("keypoints",)
    assert warnings == [(), (), ("frame 22: no keypoints; interpolated from the frames next to it",), ()]


def test_a_camera_that_is_not_there_is_an_error():
    times, _, poses = walk(2)
    with pytest.raises(InputError, match="unknown camera 'ceiling'; expected some of camera"):
        run(frames(times, keypoints(poses)), poses[0], cameras=["ceiling"])


def test_without_a_motion_the_poses_prior_holds_what_one_camera_does_not_see():
    times, _, poses = walk(4)
    shown = frames(times, keypoints(poses, sigma_px=2.0))
    steps = run(shown, problem=FrameByFrame(pose_prior=True))
    assert errors_mm(found(steps), poses)[1] < 30.0
    steps = run(shown, problem=FrameByFrame(), model=False)
    assert errors_mm(found(steps), poses)[1] < 30.0


def test_what_cannot_be_used_is_an_error():
    times, _, poses = walk(3)
    seen = keypoints(poses)
    few = seen.copy()
    few[:, 3:] = np.nan
    with pytest.raises(InputError, match="expected 4 keypoints in some frame to start from"):
        run(frames(times, few))
    with pytest.raises(InputError, match="none of 3 frames has enough observations to start from; set the phases"):
        run(frames(times, few), poses[0])
    with pytest.raises(InputError, match="expected keypoints to fit, found none in 2 frames"):
        run(frames(times[:2], [NOTHING, None]))
    weightless = seen[0].copy()
    weightless[:4, 2] = 0.0
    (one,) = observed(frames(times[:1], [weightless]))
    assert len(one.keypoints[0].joints) == 11
    assert one.keypoints[0].camera is CAMERA
