"""Reinitialization on a rendered person who is suddenly elsewhere: detection of the loss, and recovery."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from linear_gaussian import streams

from workbench.body.limbs import person
from workbench.core.frame_cache import FrameCache
from workbench.datasets.synthetic import Synthetic
from workbench.evaluation.pose_errors import step_errors
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.reinitializing import REFERENCE_FRAMES, Reinitializing
from workbench.likelihoods.cues.appearance import Appearance
from workbench.likelihoods.cues.background import Background
from workbench.likelihoods.product import Product
from workbench.priors.from_motions import walking

CUT, LEFT_OUT, AFTER = REFERENCE_FRAMES + 4, 15, 10
"""The clip goes on for so many frames, then so many are missing, half a metre of the way, and then it goes on."""
PARTICLES = 150


@pytest.fixture(scope="module")
def scene(cache):
    numba.set_num_threads(1)  # for so few points more than one costs more than it saves
    size = {"width": 160, "height": 120, "person_px": 65.0, "focal_px": 175.0}
    dataset = Synthetic(n_frames=CUT + LEFT_OUT + AFTER, keypoint_sigma_px=1.0, perturb=False, **size)
    prior = walking(motions="builtin", cache=str(cache), n_components=3, sigma_rotation=(0.0, 0.0, 0.0))
    shown = []
    for frame in dataset.frames():
        if not CUT <= frame.index < CUT + LEFT_OUT:
            index = len(shown)
            shown.append(replace(frame, index=index, time_s=index / 30.0))
    yield dataset, prior, shown
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def blind(frames):
    """The same frames, in which nobody looked for joints."""
    return [replace(frame, views=tuple(replace(view, keypoints=None) for view in frame.views)) for frame in frames]


def run(scene, make, frames):
    """Errors, px, of every frame, the width of a forearm, and the steps that started anew."""
    dataset, prior, _ = scene
    body = person(dataset.info.shape)
    cues = {"background": Background(body, FrameCache(dataset)), "appearance": Appearance(body)}
    likelihood = Product(cues, dict.fromkeys(cues, 0.5))
    steps = list(make(prior, likelihood, body).run(frames, dataset.info.initial_pose, streams(0)))
    errors = [step_errors(step, body) for step in steps]
    anew = [step for step in steps if step.diagnostics.get("reinitialized") == 1.0]
    return np.array([error["mpjpe_px"] for error in errors]), errors[-1]["forearm_width_px"], anew


def reinitializing(prior, likelihood, body):
    return Reinitializing(ParticleFilter(prior, likelihood), body, n_particles=PARTICLES)


def test_who_is_lost_is_told_by_the_cues_and_found_by_detected_joints(scene):
    errors, forearm_width_px, anew = run(scene, reinitializing, scene[2])
    assert errors[CUT - 5 : CUT].mean() < forearm_width_px
    assert errors[CUT] > 3.0 * forearm_width_px
    assert [step.frame.index for step in anew] == [CUT + 3]  # after `patience` bad frames, and not again
    assert "detected joints" in anew[0].warnings[0]
    assert errors[CUT + 3] < forearm_width_px
    assert errors[CUT + 3 :].max() < 0.5 * errors[CUT]  # so few particles may drift from there, but not back


def test_without_joints_it_goes_on_trying_about_the_last_pose(scene):
    errors, forearm_width_px, anew = run(scene, reinitializing, blind(scene[2]))
    assert errors[-1] > forearm_width_px
    assert [step.frame.index for step in anew] == [CUT + 3, CUT + 6, CUT + 9]
    assert anew[0].warnings[0].endswith("at the last pose and its mirror image")
