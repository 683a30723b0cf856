"""A product of priors over parts of the body: every part moves as its own prior says, and as if it were alone."""

import numpy as np
import pytest

from workbench.body.skeleton import PARTS, POSE_NAMES
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.factored import Partwise
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

DT = 1 / 30
ARM = [POSE_NAMES.index(name) for name in PARTS["right_arm"]]
LEGS = [POSE_NAMES.index(name) for name in PARTS["lower_body"]]


@pytest.fixture(scope="module")
def legs():
    return learn_windows(builtin_motions(3), angles=["lower_body"], root=False)


def test_a_part_moves_as_if_it_were_alone(legs):
    pose = builtin_motions(1)[0].poses[40]
    alone = Implicit(legs)
    both = Partwise({"legs": Implicit(legs), "arm": Smooth(parameters=["right_arm"])})
    lone, joined = (prior.start(pose, 50, np.random.default_rng(1)) for prior in (alone, both))
    for step in range(3):
        # the first part draws first, so that with one stream a step of each it draws what it draws alone
        lone, joined = (
            prior.step(state, DT, np.random.default_rng(step)) for prior, state in ((alone, lone), (both, joined))
        )
        np.testing.assert_array_equal(both.pose(joined)[:, LEGS], alone.pose(lone)[:, LEGS])
    poses = both.pose(joined)
    assert (poses[:, ARM].std(axis=0) > 0.0).all()
    others = np.delete(np.arange(len(POSE_NAMES)), [*ARM, *LEGS])
    assert set(both.parameters) == {POSE_NAMES[i] for i in [*ARM, *LEGS]}
    held = both.pose(both.start(pose, 50, np.random.default_rng(1)))
    np.testing.assert_array_equal(both.pose(joined)[:, others], held[:, others])


def test_the_parts_corrections_add_up(legs):
    pose = builtin_motions(1)[0].poses[40]
    weighed = Implicit(legs, search="sign_tree", reweight=True)
    prior = Partwise({"legs": weighed, "arm": Smooth(parameters=["right_arm"])})
    state = prior.start(pose, 20, np.random.default_rng(2))
    moved, log_weights = prior.propose(state, DT, np.random.default_rng(3))
    own = prior.space.slices["legs"]
    expected = weighed.propose(np.ascontiguousarray(state[:, own]), DT, np.random.default_rng(3))
    np.testing.assert_array_equal(moved[:, own], expected[0])
    np.testing.assert_array_equal(log_weights, expected[1])
    assert np.ptp(log_weights) > 0.0


def test_parts_that_share_a_parameter_are_refused():
    with pytest.raises(InputError, match="right_elbow_flexion"):
        Partwise({"arm": Smooth(parameters=["right_arm"]), "elbow": Smooth(parameters=["right_elbow_flexion"])})
    with pytest.raises(InputError, match="none"):
        Partwise({})
