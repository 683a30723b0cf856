"""Where tracking starts: whatever the prior, from a pose, from marked joints, from detected joints, or refused."""

from dataclasses import replace
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
STREAMS = ("start", "prior", "resampling")


def prior(**capabilities):
    return SimpleNamespace(capabilities=PriorCapabilities(**capabilities))


def clip(shown=(), **known):
    """A clip of frames of which that is known."""
    known = {"cameras": (CAMERA,), **known}
    return FrameCache(SimpleNamespace(info=SequenceInfo("clip", len(shown), **known), frames=lambda: iter(shown)))


def marked(times_s, poses, **noise):
    return AnnotatedFrames(np.asarray(times_s), keypoints(poses, **noise))


def apart_px(poses, truth, camera=CAMERA):
    """Mean distances (n,) in the image between the joints of poses (n, P) and of the truth (P,)."""
    seen = [camera.project(joints(SKELETON, np.atleast_2d(pose))) for pose in (poses, truth)]
    return np.linalg.norm(seen[0] - seen[1], axis=2).mean(axis=1)


def examples():
    """Poses (n, 25) of generated walkers and runners, wherever they are."""
    return np.concatenate([motion.poses[10:70:2] for motion in (*builtin_motions(4, seed=5), *builtin_runs(2, seed=5))])


# What is given.


def test_a_pose_that_the_prior_knows_comes_before_all_others():
    own, given = np.full(25, 1.0), np.full(25, 2.0)
    for known in ({"initial_pose": given}, {}):
        poses, said = initial_poses(prior(first_pose=lambda: own, motion=SineModel()), BODY, clip(**known))
        assert (poses is own, said) == (True, "")


def test_nothing_to_start_from_is_refused():
    for capabilities in ({}, {"motion": SineModel()}, {"examples": examples}):
        with pytest.raises(
            InputError, match=r"no initial pose: annotate joints .*dataset.initialization=perturbed_truth"
        ):
            initial_poses(prior(**capabilities), BODY, clip())


# Marked joints, by a cyclic motion.


def test_a_motion_is_fitted_to_marks_without_looking_at_a_frame():
    times, _, truth = walk(1, heading=2.8)
    pose, _ = initial_poses(
        prior(motion=SineModel(), examples=examples), BODY, clip(initial_annotations=marked(times, truth))
    )
    assert pose.shape == (25,)
    assert apart_px(pose, truth[0]) < 2.0  # the pull of style and lean against marks of 4 px
    assert errors_mm(SKELETON, pose[None], truth) < 50.0  # mostly depth, which one camera hardly sees


def test_marks_of_several_frames_tell_the_pace_of_the_phase():
    times, _, truth = walk(11, heading=2.8, rate_hz=0.95)
    few = [0, 3, 10]
    shown = clip(initial_annotations=marked(times[few], truth[few]), scale=0.5)
    pose, said = initial_poses(prior(motion=SineModel()), BODY, shown)
    fit = fit_annotations(SineModel(), SKELETON, CAMERA, shown.info.initial_annotations)
    assert fit.rate_hz == pytest.approx(0.95, abs=0.05)
    assert np.array_equal(pose, fit.pose)
    assert f"{fit.rate_hz:.2f} cycles/s" in said
    assert errors_mm(SKELETON, pose[None], truth[:1]) < 50.0


# Marked joints, by examples.


@pytest.mark.parametrize("distortion", [np.zeros(5), np.array([-0.3, 0.1, 0.001, -0.001, 0.0])])
@pytest.mark.parametrize("which", [7, 40, 150])
def test_the_example_that_made_the_marks_is_found_and_placed(which, distortion):
    known = examples()
    camera, truth = replace(CAMERA, distortion=distortion), known[which].copy()
    truth[:4] = [0.3, 0.2, 0.95, 2.0]
    rows = np.column_stack([camera.project(joints(SKELETON, truth[None]))[0], np.ones(15)])
    rows[4] = np.nan  # one of them was not marked
    shown = clip(cameras=(camera,), initial_annotations=AnnotatedFrames(np.zeros(1), rows[None]))
    poses, said = initial_poses(prior(examples=lambda: known), BODY, shown)
    assert apart_px(poses, truth, camera)[0] < 2.0
    assert errors_mm(SKELETON, poses[:1], truth[None]) < 30.0
    assert 1 <= len(poses) <= 8
    assert "of the prior's examples" in said
    np.testing.assert_array_equal(np.isin(poses[:, 10], known[:, 10]), True)  # angles are those of examples


def test_examples_that_fit_about_as_well_are_all_kept_and_differ():
    known = examples()
    truth = known[30].copy()
    truth[:4] = [0.3, 0.2, 0.95, 2.0]
    (seen,) = usable_annotations(SKELETON, CAMERA, marked([0.0], truth[None], sigma_px=4.0))
    poses = poses_from_examples(known, SKELETON, seen)
    places = joints(SKELETON, poses)
    apart = np.linalg.norm(places[:, None] - places, axis=3).mean(axis=2)
    assert len(poses) > 1
    assert apart[~np.eye(len(poses), dtype=bool)].min() > 0.03  # APART_M
    assert apart_px(poses, truth).max() < 15.0
    assert np.all(poses[0] == poses_from_examples(known[::-1], SKELETON, seen)[0])  # whatever their order


def test_the_linear_fit_is_exact_where_the_marks_are():
    pose = examples()[20]
    truth, heading = pose.copy(), 0.7
    truth[:4], pose[:4] = [0.3, 0.2, 0.95, heading], 0.0
    (seen,) = usable_annotations(SKELETON, CAMERA, marked([0.0], truth[None]))
    other = examples()[33]
    other[:4] = 0.0
    costs, roots = placed_costs(seen, joints(SKELETON, np.stack([pose, other]))[:, seen.joints], heading, 4.0)
    assert costs[0] == pytest.approx(0.0, abs=1e-12)
    assert costs[1] > 1.0
    np.testing.assert_allclose(roots[0], truth[:3], atol=1e-9)


# Marked joints, by nothing but the body.


@pytest.mark.parametrize("several", [False, True])
def test_without_motion_or_examples_a_pose_within_the_limits_is_fitted(several):
    times, truth = swinging(SKELETON, 8 if several else 1)
    if several:
        times[-1] = 2.0  # too late to say anything about the first frame
        truth[-1] = 0.0
    poses, said = initial_poses(prior(), BODY, clip(initial_annotations=marked(times, truth, sigma_px=1.0)))
    assert apart_px(poses[:1], truth[0]) < 5.0
    low, high = SKELETON.limits.T
    assert np.abs(poses - np.clip(poses, low, high)).max() < 0.1
    assert "of the consistent poses" in said


def test_too_few_marks_are_refused():
    rows = np.full((1, 15, 3), np.nan)
    rows[0, 1:4] = [300.0, 200.0, 1.0]
    shown = clip(initial_annotations=AnnotatedFrames(np.zeros(1), rows))
    for capabilities in ({"motion": SineModel()}, {"examples": examples}, {}):
        with pytest.raises(InputError, match="found 3"):
            initial_poses(prior(**capabilities), BODY, shown)


# Detected joints.


def test_detected_joints_come_before_what_a_prior_offers_and_no_frame_more_is_decoded():
    times, truth = swinging(SKELETON, 30)
    shown, decoded = frames(SKELETON, times, truth, sigma_px=2.0), []

    def played():
        for frame in shown:
            decoded.append(frame.index)
            yield frame

    known = SequenceInfo("clip", len(shown), cameras=CAMERAS, has_keypoints=True)
    offers = prior(motion=SineModel(), examples=examples)
    poses, said = initial_poses(offers, BODY, FrameCache(SimpleNamespace(info=known, frames=played)))
    assert np.array_equal(poses, poses_from_keypoints(SKELETON, shown))
    assert said == f"initial pose fitted to keypoints: {len(poses)} consistent poses"
    assert errors_mm(SKELETON, poses[:1], truth[:1]) < 14.0  # 2 px there
    assert decoded == list(range(9))  # half a second, and the frame that is later


def test_detected_joints_that_are_missing_in_the_first_frame_are_said():
    times, truth = swinging(SKELETON, 3)
    shown = frames(SKELETON, times, truth)
    shown[0] = replace(shown[0], views=())
    with pytest.raises(InputError, match="expected keypoints in the first frame to start from"):
        initial_poses(prior(), BODY, clip(shown, has_keypoints=True))


def test_one_camera_leaves_several_and_one_is_right():
    times, poses = swinging(SKELETON)
    poses[:, 3] = np.pi / 2.0  # away from the camera, whose picture of the person bent over backwards is as good
    found = poses_from_keypoints(SKELETON, frames(SKELETON, times, poses, CAMERAS[:1], sigma_px=2.0))
    errors = [errors_mm(SKELETON, pose[None], poses[:1]) for pose in found]
    assert min(errors) < 60.0  # as a start has to be
    assert len(found) <= 3


def test_particles_begin_around_every_start_evenly():
    poses = np.zeros((3, 25))
    poses[:, 0] = [0.0, 10.0, 20.0]
    times, still = swinging(SKELETON, 1)
    streams = {name: np.random.default_rng(k) for k, name in enumerate(STREAMS)}
    inference = ParticleFilter(Smooth(), Uniform(), n_particles=31)
    (step,) = inference.run(frames(SKELETON, times, still), poses, streams)
    assert np.bincount(np.round(step.poses[:, 0] / 10.0).astype(int)).tolist() == [11, 10, 10]
    streams = {name: np.random.default_rng(k) for k, name in enumerate(STREAMS)}
    (one,) = inference.run(frames(SKELETON, times, still), poses[1], streams)
    assert np.round(one.poses[:, 0]).tolist() == [10.0] * 31
