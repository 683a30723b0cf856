"""A filter's start from detected joints: poses the first frames allow, and particles around all of them."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, errors_mm, frames, swinging

from workbench.inference.initialization.from_keypoints import start_from_keypoints
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

SKELETON = BODY.skeleton
STREAMS = ("start", "prior", "resampling")


def test_two_cameras_leave_one_start():
    times, poses = swinging(SKELETON)
    found = start_from_keypoints(SKELETON, frames(SKELETON, times, poses, sigma_px=2.0))
    assert errors_mm(SKELETON, found[:1], poses[:1]) < 14.0  # 2 px there
    low, high = SKELETON.limits.T
    assert np.abs(found - np.clip(found, low, high)).max() < 0.1


def test_one_camera_leaves_several_and_one_is_right():
    times, poses = swinging(SKELETON)
    poses[:, 3] = np.pi / 2.0  # away from the camera, whose picture of the person bent over backwards is as good
    found = start_from_keypoints(SKELETON, frames(SKELETON, times, poses, CAMERAS[:1], sigma_px=2.0))
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


def test_nothing_to_start_from_is_an_error():
    times, poses = swinging(SKELETON, 2)
    shown = frames(SKELETON, times, poses)
    with pytest.raises(InputError, match="expected keypoints in the first frame to start from"):
        start_from_keypoints(SKELETON, [replace(shown[0], views=()), shown[1]])
