"""Smallest depths of bones by world landmarks: cost and derivatives, and the limb flips that they resolve."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, observed, swinging

from tests.oracles.landmark_depths import depth_residual
from workbench.body.kinematics import joints
from workbench.core.losses import DEPTH_LOSS, Loss
from workbench.core.prior import Smoothness
from workbench.core.residual import robust
from workbench.inference.least_squares.motion.smooth_fit import _depths
from workbench.inference.least_squares.video.landmark_depths import BONES, MIN_DEPTH_M, DepthArrays
from workbench.inference.least_squares.video.limb_flips import LIMBS, flipped
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

SKELETON, CAMERA, SIGMA_M = BODY.skeleton, CAMERAS[0], 0.1


def scene(n_frames=6, scale=1.0, noise_m=0.0, seed=0, shown=1.0):
    """Return times, observations with world landmarks of a person `scale` times as large, and true poses (T, P).

    shown: part of the depths that landmarks show.
    """
    times, poses = swinging(SKELETON, n_frames)
    rng, observations = np.random.default_rng(seed), observed(SKELETON, frames(SKELETON, times, poses, (CAMERA,)))
    places = joints(SKELETON, poses)
    with_landmarks = []
    for frame, place in zip(observations, places, strict=True):
        (view,) = frame.keypoints
        ray = CAMERA.directions(CAMERA.undistorted(view.detections[:, :2]).mean(axis=0))
        side = np.cross([0.0, 0.0, 1.0], ray)
        side /= np.linalg.norm(side)
        axes = np.stack([-side, np.cross(ray, -side), ray])  # of a camera that points at the person
        world = scale * (place - place[0])[view.joints] @ axes.T * [1.0, 1.0, shown]
        world += noise_m * rng.standard_normal((len(view.joints), 3))
        keypoints = view.detections.copy()
        keypoints[:, 2] = rng.uniform(0.3, 1.0, len(keypoints))
        with_landmarks.append(replace(frame, keypoints=(replace(view, detections=keypoints, world_landmarks=world),)))
    return times, with_landmarks, poses


def problem(times, observations, depths=None):
    keypoints = KeypointArrays.of(observations, lambda weights: np.sqrt(weights) / 3.0)
    contacts = np.zeros((len(times), 2), dtype=bool)
    return PoseProblem(SKELETON, keypoints, times, Loss("huber", 3.0), Smoothness(), contacts, depths=depths)


def test_the_true_pose_has_no_depth_cost_at_any_scale_of_the_landmarks():
    times, observations, poses = scene(scale=0.7)
    depths = DepthArrays.of(SKELETON, observations, SIGMA_M)
    same_size = DepthArrays.of(SKELETON, scene()[1], SIGMA_M)
    np.testing.assert_array_equal(depths.ends, same_size.ends)
    places, frame = joints(SKELETON, poses), np.repeat(np.arange(6), np.diff(depths.first))
    bones = places[frame, depths.ends[:, 1]] - places[frame, depths.ends[:, 0]]
    assert len(bones) > 12
    observables = SimpleNamespace(depth_sigma_m=SIGMA_M)
    task = SimpleNamespace(
        skeleton=SKELETON, observations=observations, likelihood=SimpleNamespace(observables=observables)
    )
    np.testing.assert_array_equal(_depths(task).directions, depths.directions)
    other = replace(observations[0].keypoints[0], camera=CAMERAS[1])
    task.observations = [replace(frame, keypoints=(*frame.keypoints, other)) for frame in observations]
    assert _depths(task) is None  # several cameras determine the depth
    assert ((bones * depths.directions).sum(axis=1) >= MIN_DEPTH_M).all()
    without, with_depths = (problem(times, observations, arrays).expand(poses.ravel()) for arrays in (None, depths))
    assert with_depths.cost == pytest.approx(without.cost, abs=1e-9)


@pytest.mark.parametrize(("shown", "costs"), [(0.65, False), (0.99, False), (1.01, True), (1.5, True)])
def test_a_depth_costs_below_the_landmarks_and_not_beyond(shown, costs):
    times, observations, poses = scene(shown=shown)
    depths, x = DepthArrays.of(SKELETON, observations, SIGMA_M), poses.ravel()
    without, with_depths = (problem(times, observations, arrays).expand(x).cost for arrays in (None, depths))
    assert (with_depths - without > 1e-6) == costs


def test_cost_gradient_and_curvature_equal_those_in_numpy():
    times, observations, poses = scene(noise_m=0.3)
    poses = poses + 0.2 * np.random.default_rng(1).standard_normal(poses.shape)
    without = problem(times, observations).expand(poses.ravel())
    depths = DepthArrays.of(SKELETON, observations, SIGMA_M)
    with_depths = problem(times, observations, depths).expand(poses.ravel())
    cost, gradient, normal = 0.0, np.zeros_like(poses), np.zeros((poses.size, poses.size))
    for t, frame in enumerate(observations):
        residual = depth_residual(SKELETON, frame.keypoints[0], BONES, SIGMA_M)
        values, rows = robust(residual, DEPTH_LOSS)(poses[t])
        cost, gradient[t], block = cost + 0.5 * values @ values, rows.T @ values, slice(25 * t, 25 * t + 25)
        normal[block, block] = rows.T @ rows
    assert cost > 5.0
    assert with_depths.cost - without.cost == pytest.approx(cost, rel=1e-9)
    added = with_depths.gradient - without.gradient
    np.testing.assert_allclose(added, gradient.ravel(), atol=1e-9 * np.abs(gradient).max())
    added = with_depths.normal.dense() - without.normal.dense()
    np.testing.assert_allclose(added, normal, atol=1e-9 * np.abs(normal).max())


def test_the_gradient_equals_finite_differences():
    times, observations, poses = scene(3, noise_m=0.2)
    batch = problem(times, observations, DepthArrays.of(SKELETON, observations, SIGMA_M))
    x = poses.ravel() + 0.05
    gradient, step = batch.expand(x).gradient, 1e-6
    for k in range(0, len(x), 7):
        shift = np.zeros_like(x)
        shift[k] = step
        difference = (batch.expand(x + shift).cost - batch.expand(x - shift).cost) / (2.0 * step)
        assert difference == pytest.approx(gradient[k], rel=1e-4, abs=1e-3)


def test_selected_frames_have_the_depths_of_these_frames():
    times, observations, poses = scene(noise_m=0.1)
    depths, frames_used = DepthArrays.of(SKELETON, observations, SIGMA_M), np.array([1, 4])
    selected, subset = (
        problem(times, observations, depths).select_frames(frames_used),
        [observations[1], observations[4]],
    )
    expected = problem(times[frames_used], subset, DepthArrays.of(SKELETON, subset, SIGMA_M))
    assert selected.expand(poses[frames_used].ravel()).cost == expected.expand(poses[frames_used].ravel()).cost


@pytest.mark.parametrize("limb", LIMBS)
def test_a_flipped_limb_costs_more_with_depths(limb):
    times, observations, poses = scene(30)
    wrong = flipped(SKELETON, CAMERA, poses, np.array([SKELETON.joint(name) for name in limb]))
    depths = DepthArrays.of(SKELETON, observations, SIGMA_M)
    without, with_depths = (
        np.diff([problem(times, observations, arrays).expand(x.ravel()).cost for x in (poses, wrong)])
        for arrays in (None, depths)
    )
    assert with_depths > without + 0.5


def test_frames_without_landmarks_have_no_depths():
    times, poses = swinging(SKELETON, 4)
    observations = observed(SKELETON, frames(SKELETON, times, poses, (CAMERA,)))
    depths = DepthArrays.of(SKELETON, observations, SIGMA_M)
    assert depths.first.tolist() == [0] * 5 == DepthArrays.none(4).first.tolist()
    x = (poses + 0.1).ravel()
    assert problem(times, observations, depths).expand(x).cost == problem(times, observations).expand(x).cost


def test_a_standard_deviation_that_is_not_positive_is_rejected():
    for key in ("depth_sigma_m", "sigma_px"):
        with pytest.raises(InputError, match=key):
            KeypointLikelihood(BODY, **{key: 0.0})
    assert KeypointLikelihood(BODY, depth_sigma_m=0.2).observables.depth_sigma_m == 0.2


def test_the_default_deviation_of_keypoints_is_proportional_to_the_height_in_the_image():
    times, poses = swinging(SKELETON, 5)
    clip = frames(SKELETON, times, poses, (CAMERA,))
    heights = [np.ptp(frame.views[0].keypoints[:, 1]) for frame in clip]
    likelihood = KeypointLikelihood(BODY, sigma_px=None, clip=clip)
    assert likelihood.observables.sigma_px == pytest.approx(0.015 * np.median(heights))
    assert likelihood.whitening(np.ones(1))[0] == pytest.approx(1.0 / likelihood.std_px)
    with pytest.raises(InputError, match="sigma_px"):
        KeypointLikelihood(BODY, sigma_px=None)
    hidden = [replace(frame, views=(replace(frame.views[0], keypoints=None),)) for frame in clip]
    with pytest.raises(InputError, match="usable keypoints"):
        _ = KeypointLikelihood(BODY, sigma_px=None, clip=hidden).std_px
