"""What priors offer to fits and starts: a motion, a penalty, examples, a first pose; and what wrappers pass on."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.prior import Smoothness
from workbench.motion.models.training import activity_model
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors import from_motions
from workbench.priors.activity import Activity
from workbench.priors.ar_offsets import Jitter
from workbench.priors.factored import Partwise
from workbench.priors.fitted_rest import Following, Trajectory
from workbench.priors.implicit import Implicit
from workbench.priors.kinematic_flips import Flipping
from workbench.priors.mixture import Mixture, Switching
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

HALVES = {"a": 0.5, "b": 0.5}


@pytest.fixture(scope="module")
def folder(cache):
    return str(cache)


@pytest.fixture(scope="module")
def windows():
    return learn_windows(builtin_motions(n_subjects=2), angles=["left_arm"], root=False)


@pytest.mark.parametrize("name", ["walking", "gait", "cyclic"])
def test_the_motion_of_a_cyclic_prior_is_what_it_decodes_to(folder, name):
    """To the difference of its cubic splines and the prior's linear interpolation, 1e-3 rad."""
    prior = getattr(from_motions, name)(motions="builtin", cache=folder)
    motion, rng = prior.powers.motion, np.random.default_rng(0)
    state = prior.start(builtin_motions()[0].poses[0], 50, rng)
    alpha, phase = state[:, prior.space.slices["coefficients"]], state[:, prior.space.slices["phase"]][:, 0]
    assert motion.angles == POSE_NAMES[N_ROOT:]
    np.testing.assert_allclose(motion.angles_at(alpha, phase), prior.pose(state)[:, N_ROOT:], atol=1e-3)
    mean_hz, deviation_hz = prior.model.cycle_rate_hz
    np.testing.assert_allclose(motion.cycle_rate_hz, mean_hz + deviation_hz * np.array([-2.0, 0.0, 2.0]))
    assert prior.powers.motion is motion  # so that its splines are made once


def test_the_motion_of_an_activity_prior_is_its_model(folder):
    model = activity_model(cache=folder, n_components=2)
    assert Activity(model).powers.motion is model


def test_a_penalty_is_as_given_and_else_the_default(folder):
    model = activity_model(cache=folder, n_components=2)
    made = {
        "walking": lambda **options: from_motions.walking(motions="builtin", cache=folder, **options),
        "activity": lambda **options: Activity(model, **options),
        "smooth": Smooth,
    }
    for make in made.values():
        assert make().powers.smoothness == Smoothness()
        assert make(penalty={"style": 0.1, "angle": 1.0}).powers.smoothness == Smoothness(style=0.1, angle=1.0)


@pytest.mark.parametrize(
    ("penalty", "message"),
    [({"speed": 1.0}, "'speed'"), ({"angle": 0.0}, "penalty.angle"), ({"phase": float("nan")}, "penalty.phase")],
)
def test_wrong_penalties_are_refused(penalty, message):
    with pytest.raises(InputError, match=message):
        Smooth(penalty=penalty)


def test_wrappers_pass_on_what_still_holds(folder, windows):
    walking = from_motions.walking(motions="builtin", cache=folder)
    jitter = Jitter(walking)
    assert jitter.powers.motion is walking.powers.motion
    assert jitter.powers.smoothness is None
    flipping = Flipping(jitter, lambda: None)
    assert flipping.powers.motion is walking.powers.motion
    followed = Following(Smooth(parameters=["left_arm"]), lambda: Trajectory(np.zeros(1), np.ones((1, 25))))
    assert (followed.powers.first_pose() == 1.0).all()
    assert (Flipping(followed, lambda: None).powers.first_pose() == 1.0).all()
    arm = Implicit(windows)
    assert len(Jitter(arm).powers.examples()) == len(arm.powers.examples())


def test_what_several_priors_have_in_common(windows):
    calm, stiff, arm = Smooth(damping=1.0), Smooth(penalty={"angle": 0.1}), Implicit(windows)
    for together in (Mixture, Switching):
        assert together({"a": calm, "b": Smooth()}, HALVES).powers.smoothness == Smoothness()
        assert together({"a": calm, "b": stiff}, HALVES).powers.smoothness is None
        assert together({"a": calm, "b": stiff}, HALVES).powers.examples is None
        examples = together({"a": arm, "b": Implicit(windows, beta=0.5)}, HALVES).powers.examples()
        assert len(examples) == 2 * len(arm.powers.examples())
    parts = {"arm": Smooth(parameters=["left_arm"]), "root": Smooth(parameters=["root"])}
    assert Partwise(parts).powers.smoothness == Smoothness()
    assert Partwise(parts).powers.examples is None


def test_examples_of_parts_are_put_together(windows):
    arm, legs = (
        Implicit(windows),
        Implicit(learn_windows(builtin_motions(n_subjects=1), angles=["lower_body"], root=False)),
    )
    poses = Partwise({"arm": arm, "legs": legs, "other": Smooth(parameters=["right_arm"])}).powers.examples()
    mine, theirs = arm.powers.examples(), legs.powers.examples()
    assert len(poses) == len(mine) > len(theirs)
    own = np.isin(POSE_NAMES, legs.parameters)
    np.testing.assert_array_equal(poses[:, ~own], mine[:, ~own])
    assert {row.tobytes() for row in poses[:, own]} == {row.tobytes() for row in theirs[:, own]}
