"""What every prior keeps: shapes, names, finite numbers, seeds, untouched inputs, and a pose per state."""

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.gait import builtin_motions
from workbench.learning.walking import learn_walking
from workbench.priors.cyclic import Cyclic
from workbench.priors.mixture import Enterable, Mixture, Switching
from workbench.priors.smooth import Smooth

P, DT = len(POSE_NAMES), 1 / 30
ARM = [f"left_{name}" for name in ("shoulder_abduction", "shoulder_flexion", "shoulder_twist", "elbow_flexion")]
NAMES = ("cyclic", "smooth", "smooth_arm", "mixture", "switching")


@pytest.fixture(scope="module")
def walk():
    return builtin_motions()[0]


@pytest.fixture(scope="module")
def priors():
    cyclic = Cyclic(learn_walking(builtin_motions(), n_components=4))
    calm, lively = Smooth(damping=3.0), Smooth(sigma_velocity={"knee": 4.0})
    halves = {"calm": 0.5, "lively": 0.5}
    return {
        "cyclic": cyclic,
        "smooth": Smooth(),
        "smooth_arm": Smooth(parameters=ARM, start_uniform=["left_shoulder_twist"]),
        "mixture": Mixture({"calm": calm, "lively": lively}, halves, shares={"calm": 0.2, "lively": 0.8}),
        "switching": Switching({"walk": cyclic, "free": Smooth()}, {"walk": 0.8, "free": 0.2}, switching=0.3),
    }


@pytest.fixture(params=NAMES)
def prior(request, priors):
    return priors[request.param]


def run(prior, pose, n, seed, n_steps=3):
    rng = np.random.default_rng(seed)
    state = prior.start(pose, n, rng)
    states = [state]
    for _ in range(n_steps):
        states.append(prior.step(states[-1], DT, rng))
    return states


@pytest.mark.parametrize("n", [1, 2, 37])
def test_shapes_and_finite_numbers(prior, walk, n):
    for state in run(prior, walk.poses[0], n, seed=0):
        poses = prior.pose(state)
        for array, width in ((state, len(prior.space)), (poses, P)):
            assert array.shape == (n, width)
            assert array.dtype == np.float64
            assert array.flags.c_contiguous
            assert np.isfinite(array).all()


def test_every_column_has_one_name_and_a_unit_and_groups_are_inside(prior):
    space = prior.space
    assert len(set(space.names)) == len(space.names) == len(space.units) == len(space)
    for columns in space.slices.values():
        assert 0 <= columns.start <= columns.stop <= len(space)
    in_groups = {i for columns in space.slices.values() for i in range(len(space))[columns]}
    assert in_groups == set(range(len(space)))


def test_the_same_seed_gives_the_same_states_and_another_seed_others(prior, walk):
    first, again, other = (run(prior, walk.poses[0], 20, seed)[-1] for seed in (5, 5, 6))
    assert (first == again).all()
    assert (first != other).any()


def test_no_memory_but_the_state(prior, walk):
    """Stepping two particle sets in turn gives what stepping each alone gives: a prior keeps nothing of a run."""
    one, two = (run(prior, walk.poses[i], 10, seed=i) for i in (0, 5))
    states, generators = [], [np.random.default_rng(i) for i in (0, 5)]
    for i, rng in zip((0, 5), generators, strict=True):
        states.append(prior.start(walk.poses[i], 10, rng))
    for _ in range(3):
        states = [prior.step(state, DT, rng) for state, rng in zip(states, generators, strict=True)]
    assert (states[0] == one[-1]).all()
    assert (states[1] == two[-1]).all()
    assert (prior.pose(states[0]) == prior.pose(one[-1])).all()


def test_inputs_are_left_alone(prior, walk):
    rng, pose = np.random.default_rng(0), walk.poses[0].copy()
    state = prior.start(pose, 10, rng)
    kept = state.copy()
    state.flags.writeable = pose.flags.writeable = False
    prior.pose(prior.step(state, DT, rng))
    assert (state == kept).all()
    assert (pose == walk.poses[0]).all()


def test_the_start_is_around_the_pose(prior, walk):
    """Parameters that start uniform aside; 5 standard errors, and what a cyclic model misses of a pose it learned."""
    pose = walk.poses[0]
    poses = prior.pose(prior.start(pose, 4000, np.random.default_rng(1)))
    apart = np.abs(poses.mean(axis=0) - pose)
    calm = [i for i, name in enumerate(POSE_NAMES) if name != "left_shoulder_twist"]
    assert (apart[calm] <= 5 * poses.std(axis=0)[calm] / np.sqrt(4000) + 0.1).all()


def test_particles_are_stepped_one_by_one_alike(prior, walk):
    """The order of the particles says nothing: identical parents have identically distributed children."""
    state = np.repeat(prior.start(walk.poses[0], 1, np.random.default_rng(2)), 4000, axis=0)
    poses = prior.pose(prior.step(state, DT, np.random.default_rng(3)))
    halves = poses[:2000], poses[2000:]
    error = poses.std(axis=0) * np.sqrt(2 / 2000)
    assert (np.abs(halves[0].mean(axis=0) - halves[1].mean(axis=0)) <= 5 * error + 1e-12).all()


def test_who_can_take_over_a_moving_pose(priors, walk):
    entering = priors["smooth"]
    assert isinstance(entering, Enterable)
    assert not isinstance(priors["cyclic"], Enterable)
    poses, velocities = walk.poses[:6], walk.velocities[:6]
    state = entering.enter(poses, velocities)
    assert (entering.pose(state) == poses).all()
    assert (state[:, entering.space.slices["velocity"]] == velocities).all()
