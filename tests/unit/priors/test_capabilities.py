"""Capabilities of priors: a motion, a smoothness, examples and a first pose; and those that wrappers pass on."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.prior import Smoothness
from workbench.motion.models.training import activity_model
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors import from_motions
from workbench.priors.activity import Activity
from workbench.priors.ar_offsets import AROffsets
from workbench.priors.fitted_rest import FittedRest, Trajectory
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth


@pytest.fixture(scope="module")
def folder(cache):
    return str(cache)


@pytest.fixture(scope="module")
def windows():
    return learn_windows(builtin_motions(n_subjects=2), angles=["left_arm"], include_root=False)


@pytest.mark.parametrize("name", ["walking", "gait", "cyclic"])
def test_the_motion_of_a_cyclic_prior_gives_its_poses(folder, name):
    """The motion's cubic splines and the prior's linear interpolation differ by at most 1e-3 rad."""
    prior = getattr(from_motions, name)(motions="builtin", cache=folder)
    motion, rng = prior.capabilities.motion, np.random.default_rng(0)
    state = prior.sample_initial(builtin_motions()[0].poses[0], 50, rng)
    alpha, phase = state[:, prior.space.slices["coefficients"]], state[:, prior.space.slices["phase"]][:, 0]
    assert motion.angles == POSE_NAMES[N_ROOT:]
    np.testing.assert_allclose(motion.angles_at(alpha, phase), prior.pose(state)[:, N_ROOT:], atol=1e-3)
    mean_hz, deviation_hz = prior.model.cycle_rate_hz
    np.testing.assert_allclose(motion.cycle_rate_hz, mean_hz + deviation_hz * np.array([-2.0, 0.0, 2.0]))
    assert prior.capabilities.motion is motion  # its splines are made once


def test_the_smoothness_is_the_penalty_or_the_default(folder):
    model = activity_model(cache=folder, n_components=2)
    priors = {
        "walking": lambda **options: from_motions.walking(motions="builtin", cache=folder, **options),
        "activity": lambda **options: Activity(model, **options),
        "smooth": Smooth,
    }
    for make in priors.values():
        assert make().capabilities.smoothness == Smoothness()
        assert make(penalty={"style": 0.1, "angle": 1.0}).capabilities.smoothness == Smoothness(style=0.1, angle=1.0)


def test_wrappers_pass_on_the_capabilities_of_their_base(folder, windows):
    walking = from_motions.walking(motions="builtin", cache=folder)
    offsets = AROffsets(walking)
    assert offsets.capabilities.motion is walking.capabilities.motion
    assert offsets.capabilities.smoothness is None
    fitted = FittedRest(Smooth(parameters=["left_arm"]), lambda: Trajectory(np.zeros(1), np.ones((1, 25))))
    assert (fitted.capabilities.first_pose() == 1.0).all()
    arm = Implicit(windows)
    assert len(AROffsets(arm).capabilities.examples()) == len(arm.capabilities.examples())
