"""Least squares on 2-D keypoints of one camera: automatic initialization, missing and wrong keypoints."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, NOTHING, PX_M, errors_mm, frames, keypoints, streams, walk
from least_squares_scenes import PriorStub, SineModel

from workbench.core.frame import Frame
from workbench.core.observations import observe, observed_kinds
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

ANKLES = [BODY.skeleton.joint("left_ankle"), BODY.skeleton.joint("right_ankle")]
STEADY = MotionFit(frames_per_style=None)


def observed(sequence):
    return observe(sequence, BODY.skeleton, 1000, np.random.default_rng(0))[0]


def run(sequence, start=None, model=True, problem=STEADY, phase_ends=None, **options):
    prior, likelihood = PriorStub(motion=SineModel()) if model else None, KeypointLikelihood(BODY, **options)
    inference = LeastSquares(BODY, likelihood, prior, phase_ends, problem=problem, n_particles=20)
    return list(inference.run(sequence, start, streams()))


def estimates(steps):
    return np.array([step.expected_pose for step in steps])


def phase_error(steps, phases):
    mu = np.array([step.particles[:, 2].mean() for step in steps])
    return np.abs((mu - phases + 0.5) % 1.0 - 0.5).max()


@pytest.mark.parametrize("heading_deg", [0, 50, 130, 180, 270])
@pytest.mark.slow
def test_a_walk_is_fitted_to_keypoints_without_an_initial_pose(heading_deg):
    times, phases, poses = walk(8, heading=np.radians(heading_deg))
    steps = run(frames(times, keypoints(poses, sigma_px=3.0, missing=0.1)))
    in_space_mm, in_image_mm = errors_mm(estimates(steps), poses)
    # In the image the motion averages the noise of single keypoints; depth follows from the size of the person.
    assert in_image_mm < 3.0 * 1e3 * PX_M
    assert in_space_mm < 100.0
    heading_errors = estimates(steps)[:, 3] - np.radians(heading_deg)
    assert np.abs((heading_errors + np.pi) % (2.0 * np.pi) - np.pi).max() < np.radians(20.0)
    assert phase_error(steps, phases) < 0.1
    assert all(step.warnings == () for step in steps)
    assert all(step.attachment is None for step in steps)


def test_frames_without_keypoints_are_interpolated_and_reported():
    times, _, poses = walk(13)
    detections = [rows if t in (1, 2, 6, 10, 11) else None for t, rows in enumerate(keypoints(poses, sigma_px=2.0))]
    steps = run(frames(times, detections), start=poses[0])
    warnings = {t: step.warnings for t, step in enumerate(steps) if step.warnings}
    assert warnings == {
        0: ("frame 20: no keypoints; interpolated from the frames next to it",),
        3: ("frames 23 to 25: no keypoints; interpolated from the frames next to them",),
        7: ("frames 27 to 29: no keypoints; interpolated from the frames next to them",),
        12: ("frame 32: no keypoints; interpolated from the frames next to it",),
    }
    # Between keypoints a third of a second away in time the error is that of single keypoints.
    between = [3, 4, 5, 7, 8, 9]
    assert errors_mm(estimates(steps)[between], poses[between])[1] < 30.0
    deviations = [step.poses[:, 0].std() for step in steps]  # along the image; those in depth are all equal
    assert deviations[8] > 1.2 * deviations[6]


def test_several_frames_resolve_the_ambiguity_of_one():
    """Without ankles the poses at the phases μ and −μ have the same image; the motion of the hips differs."""
    times, phases, poses = walk(6, phase=0.3)
    detections = keypoints(poses)
    detections[:, ANKLES] = np.nan
    residual = KeypointLikelihood(BODY, sigma_px=3.0).residual_function(observed(frames(times, detections))[0])
    decoder = MotionDecoder(BODY.skeleton, SineModel(), poses[0])
    twin = decoder.poses(decoder.states(np.array([0.5, -0.5]), -phases[:1], poses[:1, :6]))[0]
    assert np.abs(twin - poses[0]).max() > 0.1
    np.testing.assert_allclose(residual(twin)[0], residual(poses[0])[0], atol=1e-6)
    assert phase_error(run(frames(times, detections)), phases) < 0.05


def test_a_redescending_loss_ignores_wrong_keypoints():
    times, phases, poses = walk()
    options = {"start": poses[0], "problem": MotionFit(), "phase_ends": (phases[0], phases[-1])}
    detections = keypoints(poses, sigma_px=2.0)
    wrong = np.random.default_rng(5).random(detections.shape[:2]) < 0.1
    detections[wrong, :2] += 80.0
    squared, robust = (
        errors_mm(estimates(run(frames(times, detections), loss=loss, **options)), poses)[1]
        for loss in ("squared", "geman_mcclure")
    )
    assert robust < 15.0 < squared


def test_frames_with_points_and_keypoints_have_both_observations():
    times, _, poses = walk(4)
    rng = np.random.default_rng(1)
    points = poses[0, :3] + 0.1 * rng.standard_normal((40, 3))
    both = [Frame(frame.index, frame.time_s, frame.views, points=points) for frame in frames(times, keypoints(poses))]
    both[2] = Frame(22, times[2], ())
    observations, warnings = observe(both, BODY.skeleton, 1000, rng)
    assert observed_kinds(observations) == ("points", "keypoints")
    assert warnings[2] == ("frame 22: no points or keypoints; interpolated from the frames next to it",)
    observations, warnings = observe(both, BODY.skeleton, 10, rng, KeypointLikelihood(BODY).observables)
    assert observed_kinds(observations) == ("keypoints",)
    assert warnings == [(), (), ("frame 22: no keypoints; interpolated from the frames next to it",), ()]


def test_an_unknown_camera_is_rejected():
    times, _, poses = walk(2)
    with pytest.raises(InputError, match="unknown camera 'ceiling'; expected some of camera"):
        run(frames(times, keypoints(poses)), poses[0], cameras=["ceiling"])


def test_single_frames_are_fitted_without_a_motion_model():
    times, _, poses = walk(4)
    sequence = frames(times, keypoints(poses, sigma_px=2.0))
    steps = run(sequence, problem=FrameByFrame(), model=False)
    assert errors_mm(estimates(steps), poses)[1] < 30.0


def test_too_few_keypoints_are_rejected():
    times, _, poses = walk(3)
    few = keypoints(poses)
    few[:, 3:] = np.nan
    with pytest.raises(InputError, match="expected 4 keypoints in some frame to start from"):
        run(frames(times, few))
    with pytest.raises(
        InputError, match="expected points or 4 keypoints of one view in some of 3 frames to start from"
    ):
        run(frames(times, few), poses[0])
    with pytest.raises(InputError, match="expected keypoints to fit, found none in 2 frames"):
        run(frames(times[:2], [NOTHING, None]))


def test_keypoints_of_weight_zero_are_not_observed():
    times, _, poses = walk(1)
    detections = keypoints(poses)
    detections[0, :4, 2] = 0.0
    (observation,) = observed(frames(times, detections))
    assert len(observation.keypoints[0].joints) == 11
    assert observation.keypoints[0].camera is CAMERA


def test_images_are_not_kept():
    """Every iteration decodes new images, of which one is alive at a time, as the steps have one."""
    times, _, poses = walk(6)
    sequence, images, most = frames(times, keypoints(poses)), list[weakref.ref](), 0

    class Decoded:
        def __iter__(self):
            nonlocal most
            for frame in sequence:
                image = np.zeros((4, 4), np.uint8)
                images.append(weakref.ref(image))
                most = max(most, sum(each() is not None for each in images))
                yield replace(frame, views=tuple(replace(view, image=image) for view in frame.views))

    inference = LeastSquares(BODY, KeypointLikelihood(BODY), n_particles=20)
    steps = inference.run(Decoded(), poses[0], streams())
    assert [step.frame.views[0].image.shape for step in steps] == [(4, 4)] * 6
    assert 0 < most <= 3
