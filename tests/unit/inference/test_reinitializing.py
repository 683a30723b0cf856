"""Reinitialization after a jump of a rendered person: detection of the track loss, and recovery."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from linear_gaussian import streams

from workbench.body.limbs import person
from workbench.core.frame_cache import FrameCache
from workbench.datasets.synthetic import Synthetic
from workbench.evaluation.errors.pose_errors import step_errors
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.reinitializing import PATIENCE, REFERENCE_FRAMES, Reinitializing
from workbench.likelihoods.cues.appearance import Appearance
from workbench.likelihoods.cues.background import Background
from workbench.likelihoods.product import Product
from workbench.priors.from_motions import walking

CUT, OMITTED, REMAINING = REFERENCE_FRAMES + 4, 15, 10
"""Numbers of frames before a jump by half a metre, of omitted frames, and of frames after it."""


@pytest.fixture(scope="module")
def scene(cache):
    numba.set_num_threads(1)  # the particles are too few for more
    size = {"width": 160, "height": 120, "person_px": 65.0, "focal_px": 175.0}
    dataset = Synthetic(n_frames=CUT + OMITTED + REMAINING, keypoint_sigma_px=1.0, perturb=False, **size)
    prior = walking(motions="builtin", cache=str(cache), n_components=3, sigma_rotation=(0.0, 0.0, 0.0))
    frames = [frame for frame in dataset.frames() if not CUT <= frame.index < CUT + OMITTED]
    yield dataset, prior, [replace(frame, index=t, time_s=t / 30.0) for t, frame in enumerate(frames)]
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def run(scene, with_keypoints):
    """Return the errors of all frames and the width of a forearm, px, and the steps with a reinitialization."""
    dataset, prior, frames = scene
    if not with_keypoints:
        frames = [replace(frame, views=(replace(frame.views[0], keypoints=None),)) for frame in frames]
    body = person(dataset.info.shape)
    cues = {"background": Background(body, FrameCache(dataset)), "appearance": Appearance(body)}
    likelihood = Product(cues, dict.fromkeys(cues, 0.5))
    tracker = Reinitializing(ParticleFilter(prior, likelihood), body, n_particles=150)
    steps = list(tracker.run(frames, dataset.info.initial_pose, streams(0)))
    errors = [step_errors(step, body) for step in steps]
    reinitialized = [step for step in steps if step.diagnostics.get("reinitialized") == 1.0]
    return np.array([error["mpjpe_px"] for error in errors]), errors[-1]["forearm_width_px"], reinitialized


def test_a_lost_track_is_recovered_from_detected_joints(scene):
    errors, forearm_width_px, reinitialized = run(scene, with_keypoints=True)
    assert errors[CUT - 5 : CUT].mean() < forearm_width_px
    assert errors[CUT] > 3.0 * forearm_width_px
    assert [step.frame.index for step in reinitialized] == [CUT + PATIENCE]
    assert "detected joints" in reinitialized[0].warnings[0]
    assert errors[CUT + PATIENCE] < forearm_width_px
    assert errors[CUT + PATIENCE :].max() < 0.5 * errors[CUT]  # 150 particles may drift afterwards


def test_without_joints_the_last_pose_is_tried_repeatedly(scene):
    errors, forearm_width_px, reinitialized = run(scene, with_keypoints=False)
    assert errors[-1] > forearm_width_px
    assert [step.frame.index for step in reinitialized] == [CUT + k * PATIENCE for k in (1, 2, 3)]
    assert reinitialized[0].warnings[0].endswith("at the last pose and its mirror image")
