"""Initial poses: from the prior, from annotated joints, from detected joints, or rejected."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, keypoints, walk
from least_squares_scenes import SineModel
from view_scenes import CAMERAS, errors_mm, frames, swinging

from workbench.body.kinematics import joints
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import AnnotatedFrames
from workbench.core.frame_cache import FrameCache
from workbench.core.prior import PriorCapabilities
from workbench.inference.initialization.from_keypoints import poses_from_keypoints
from workbench.inference.initialization.poses import (
    MIN_SEPARATION_M,
    fit_annotations,
    initial_poses,
    placed_costs,
    poses_from_examples,
    usable_annotations,
)
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import builtin_runs
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

SKELETON = BODY.skeleton
STREAMS = ("start", "prior", "resampling", "draws")


def prior(**capabilities):
    return SimpleNamespace(capabilities=PriorCapabilities(**capabilities))


def clip(frames=(), **info):
    info = SequenceInfo("clip", len(frames), **{"cameras": (CAMERA,), **info})
    return FrameCache(SimpleNamespace(info=info, frames=lambda: iter(frames)))


def annotated(times_s, poses, **noise):
    return AnnotatedFrames(np.asarray(times_s), keypoints(poses, **noise))


def errors_px(poses, truth, camera=CAMERA):
    """Return mean distances (n,) in the image between the joints of poses (n, P) and of the truth (P,)."""
    pixels = [camera.project(joints(SKELETON, np.atleast_2d(pose))) for pose in (poses, truth)]
    return np.linalg.norm(pixels[0] - pixels[1], axis=2).mean(axis=1)


@cache
def examples():
    """Return poses (n, 25) of generated walkers and runners."""
    return np.concatenate([motion.poses[10:70:2] for motion in (*builtin_motions(4, seed=5), *builtin_runs(2, seed=5))])


def placed_example(index):
    """Return an example 5 m in front of the camera."""
    pose = examples()[index].copy()
    pose[:4] = [0.3, 0.2, 0.95, 2.0]
    return pose


# Without annotations and detections.


@pytest.mark.parametrize("info", [{"initial_pose": np.full(25, 2.0)}, {}])
def test_the_pose_of_the_prior_has_precedence(info):
    first_pose = np.full(25, 1.0)
    poses, message = initial_poses(prior(first_pose=lambda: first_pose, motion=SineModel()), BODY, clip(**info))
    assert (poses is first_pose, message) == (True, "")


@pytest.mark.parametrize("capabilities", [{}, {"motion": SineModel()}, {"examples": examples}])
def test_a_clip_without_an_initial_pose_is_rejected(capabilities):
    with pytest.raises(InputError, match=r"no initial pose: annotate joints .*dataset.initialization=perturbed_truth"):
        initial_poses(prior(**capabilities), BODY, clip())


# Annotated joints and a cyclic motion.


def test_a_motion_is_fitted_to_annotations():
    times, _, truth = walk(1, heading=2.8)
    capabilities = prior(motion=SineModel(), examples=examples)
    pose, _ = initial_poses(capabilities, BODY, clip(initial_annotations=annotated(times, truth)))
    assert pose.shape == (25,)
    assert errors_px(pose, truth[0]) < 2.0  # the bias by the priors of style and lean; annotations have 4 px
    assert errors_mm(SKELETON, pose[None], truth) < 50.0  # mostly in depth


def test_annotations_of_several_frames_determine_the_cycle_rate():
    times, _, truth = walk(11, heading=2.8, rate_hz=0.95)
    annotations = annotated(times[[0, 3, 10]], truth[[0, 3, 10]])
    pose, message = initial_poses(prior(motion=SineModel()), BODY, clip(initial_annotations=annotations, scale=0.5))
    fit = fit_annotations(SineModel(), SKELETON, CAMERA, annotations)
    assert fit.rate_hz == pytest.approx(0.95, abs=0.05)
    assert np.array_equal(pose, fit.pose)
    assert f"{fit.rate_hz:.2f} cycles/s" in message
    assert errors_mm(SKELETON, pose[None], truth[:1]) < 50.0


# Annotated joints and examples.


@pytest.mark.parametrize("distortion", [np.zeros(5), np.array([-0.3, 0.1, 0.001, -0.001, 0.0])])
@pytest.mark.parametrize("index", [7, 40, 150])
def test_the_annotated_example_is_selected_and_placed(index, distortion):
    camera, truth = replace(CAMERA, distortion=distortion), placed_example(index)
    rows = np.column_stack([camera.project(joints(SKELETON, truth[None]))[0], np.ones(15)])
    rows[4] = np.nan  # not annotated
    sequence = clip(cameras=(camera,), initial_annotations=AnnotatedFrames(np.zeros(1), rows[None]))
    poses, message = initial_poses(prior(examples=examples), BODY, sequence)
    assert errors_px(poses, truth, camera)[0] < 2.0
    assert errors_mm(SKELETON, poses[:1], truth[None]) < 30.0
    assert 1 <= len(poses) <= 8
    assert "of the prior's examples" in message
    assert np.isin(poses[:, 10], examples()[:, 10]).all()  # the angles are those of examples


def test_all_examples_with_a_similar_error_are_selected():
    truth = placed_example(30)
    (annotation,) = usable_annotations(SKELETON, CAMERA, annotated([0.0], truth[None], sigma_px=4.0))
    poses = poses_from_examples(examples(), SKELETON, annotation)
    positions = joints(SKELETON, poses)
    distances = np.linalg.norm(positions[:, None] - positions, axis=3).mean(axis=2)
    assert len(poses) > 1
    assert distances[~np.eye(len(poses), dtype=bool)].min() > MIN_SEPARATION_M
    assert errors_px(poses, truth).max() < 15.0
    assert np.all(poses[0] == poses_from_examples(examples()[::-1], SKELETON, annotation)[0])  # in any order


def test_the_linear_fit_of_the_root_is_exact():
    truth = placed_example(20)
    unplaced = examples()[[20, 33]].copy()
    unplaced[:, :4] = 0.0
    (annotation,) = usable_annotations(SKELETON, CAMERA, annotated([0.0], truth[None]))
    costs, roots = placed_costs(annotation, joints(SKELETON, unplaced)[:, annotation.joints], truth[3], 4.0)
    assert costs[0] == pytest.approx(0.0, abs=1e-12)
    assert costs[1] > 1.0
    np.testing.assert_allclose(roots[0], truth[:3], atol=1e-9)


# Annotated joints without motions or examples.


@pytest.mark.parametrize("n_frames", [1, 8])
def test_a_pose_within_the_limits_is_fitted_to_annotations(n_frames):
    times, truth = swinging(SKELETON, n_frames)
    if n_frames > 1:
        times[-1], truth[-1] = 2.0, 0.0  # too late to be used for the first frame
    poses, message = initial_poses(prior(), BODY, clip(initial_annotations=annotated(times, truth, sigma_px=1.0)))
    assert errors_px(poses[:1], truth[0]) < 5.0
    assert np.abs(poses - np.clip(poses, *SKELETON.limits.T)).max() < 0.1
    assert "of the consistent poses" in message


@pytest.mark.parametrize("capabilities", [{"motion": SineModel()}, {"examples": examples}, {}])
def test_too_few_annotations_are_rejected(capabilities):
    rows = np.full((1, 15, 3), np.nan)
    rows[0, 1:4] = [300.0, 200.0, 1.0]
    with pytest.raises(InputError, match="found 3"):
        initial_poses(prior(**capabilities), BODY, clip(initial_annotations=AnnotatedFrames(np.zeros(1), rows)))


# Detected joints.


def test_detected_joints_have_precedence_over_motions_and_examples():
    times, truth = swinging(SKELETON, 30)
    sequence = frames(SKELETON, times, truth, sigma_px=2.0)
    remaining = iter(sequence)
    info = SequenceInfo("clip", len(sequence), cameras=CAMERAS, has_keypoints=True)
    capabilities = prior(motion=SineModel(), examples=examples)
    dataset = SimpleNamespace(info=info, frames=lambda: remaining)
    poses, message = initial_poses(capabilities, BODY, FrameCache(dataset))
    assert np.array_equal(poses, poses_from_keypoints(SKELETON, sequence))
    assert message == f"initial pose fitted to keypoints: {len(poses)} consistent poses"
    assert errors_mm(SKELETON, poses[:1], truth[:1]) < 14.0  # 2 px
    assert next(remaining).index == 9  # half a second and one more frame are decoded


def test_missing_detections_in_the_first_frame_are_rejected():
    times, truth = swinging(SKELETON, 3)
    sequence = frames(SKELETON, times, truth)
    sequence[0] = replace(sequence[0], views=())
    with pytest.raises(InputError, match="expected keypoints in the first frame to start from"):
        initial_poses(prior(), BODY, clip(sequence, has_keypoints=True))


def test_one_of_the_poses_consistent_with_one_camera_is_true():
    times, truth = swinging(SKELETON)
    truth[:, 3] = np.pi / 2.0  # facing away; a person who bends backwards has the same image
    poses = poses_from_keypoints(SKELETON, frames(SKELETON, times, truth, CAMERAS[:1], sigma_px=2.0))
    assert min(errors_mm(SKELETON, pose[None], truth[:1]) for pose in poses) < 60.0
    assert len(poses) <= 3


def test_particles_are_distributed_evenly_over_the_initial_poses():
    poses = np.zeros((3, 25))
    poses[:, 0] = [0.0, 10.0, 20.0]
    times, truth = swinging(SKELETON, 1)

    def sampled(start):
        streams = {name: np.random.default_rng(k) for k, name in enumerate(STREAMS)}
        (step,) = ParticleFilter(Smooth(), Uniform(), n_particles=31).run(
            frames(SKELETON, times, truth), start, streams
        )
        return np.bincount(np.round(step.poses[:, 0] / 10.0).astype(int)).tolist()

    assert sampled(poses) == [11, 10, 10]
    assert sampled(poses[1]) == [0, 31]
