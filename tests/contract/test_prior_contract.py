"""The contract of every prior: names, shapes, seeds, unchanged inputs, poses, moving parameters and densities."""

from functools import cache
from importlib.resources import files
from itertools import pairwise, product

import numpy as np
import pytest
from hydra import compose, initialize_config_module

from workbench.body.skeleton import POSE_NAMES
from workbench.core.prior import Proposing
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.schema import prepare_hydra
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.fitted_rest import Trajectory
from workbench.priors.implicit import PREDICTIONS, TREES, Implicit
from workbench.priors.smooth import Smooth

P, DT = len(POSE_NAMES), 1 / 30
ARM = [f"left_{name}" for name in ("shoulder_abduction", "shoulder_flexion", "shoulder_twist", "elbow_flexion")]
YAMLS = sorted(path.name for path in files("workbench.conf").joinpath("prior").iterdir() if path.suffix == ".yaml")
MANY = 4000
"""Particles where a mean is tested. Tolerances are five standard errors unless a docstring states another bound."""


@cache
def walk():
    return builtin_motions()[0].resampled(1 / DT)


@cache
def windows(angles, root):
    return learn_windows(builtin_motions(n_subjects=4), angles=angles, include_root=root)


def implicit(parts, root, search, prediction, **options):
    return Implicit(windows(parts, root), search=search, prediction=prediction, **options)


BUILDERS = {
    "smooth arm": lambda folder: Smooth(parameters=ARM, initial_uniform=["left_shoulder_twist"]),
    "reweighted": lambda folder: implicit(("body",), True, "sign_tree", "copy", importance_correction=True, beta=1.0),
} | {
    f"implicit {where}, {search}, {prediction}": lambda folder, how=(parts, root, search, prediction): implicit(*how)
    for (where, parts, root), search, prediction in product(
        [("body", ("body",), True), ("arm", ("left_arm",), False)], TREES, PREDICTIONS
    )
}


def composed(name, folder):
    """Build a prior as `workbench run prior=NAME` does, with databases of built-in motions."""
    prepare_hydra()
    overrides = [f"prior={name.removesuffix('.yaml')}", f"paths.cache={folder}", "paths.data=null"]
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=["experiment=custom", "training.motions=builtin", *overrides]).prior
    return build(config, trajectory=lambda: Trajectory(np.zeros(1), walk().poses[:1]))


@pytest.fixture(scope="module")
def cache_folder(cache):
    return str(cache)


NAMES = [*BUILDERS, *YAMLS]
WITH_DATABASE = [name for name in NAMES if name.startswith(("implicit", "reweighted", "fitted_rest_implicit"))]
WITH_DENSITY = [name for name in NAMES if not name.startswith("reweighted") and "_tree" not in name]
WITH_ROOT = [name for name in NAMES if "arm" not in name and name != "reweighted"]
WITH_NOISE_ALONE = [name for name in NAMES if name not in WITH_DATABASE and not name.startswith("linear")]


@pytest.fixture(scope="module", params=NAMES)
def prior(request, cache_folder):
    name = request.param
    return composed(name, cache_folder) if name in YAMLS else BUILDERS[name](cache_folder)


def run(prior, pose, n, seed, n_steps=3):
    rng = np.random.default_rng(seed)
    states = [prior.sample_initial(pose, n, rng)]
    for _ in range(n_steps):
        states.append(prior.sample_transition(states[-1], DT, rng))
    return states


def children(prior, dt_s=DT):
    """Return a parent state (1, D) after one transition, and MANY states sampled from it."""
    parent = run(prior, walk().poses[0], 1, seed=2, n_steps=1)[-1]
    return parent, prior.sample_transition(np.repeat(parent, MANY, axis=0), dt_s, generator(3))


def only(names):
    """Parametrize a test with these priors."""
    return pytest.mark.parametrize("prior", names, indirect=True, scope="module")


def generator(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("n", [1, 2, 37])
def test_states_and_poses_have_their_shape_and_are_finite(prior, n):
    for state in run(prior, walk().poses[0], n, seed=0):
        poses = prior.pose(state)
        for array, width in ((state, len(prior.space)), (poses, P)):
            assert array.shape == (n, width)
            assert array.dtype == np.float64
            assert array.flags.c_contiguous
            assert np.isfinite(array).all()


def test_every_column_has_one_name_one_unit_and_one_group(prior):
    space = prior.space
    assert len(set(space.names)) == len(space.names) == len(space.units) == len(space)
    for columns in space.slices.values():
        assert 0 <= columns.start <= columns.stop <= len(space)
    in_groups = {i for columns in space.slices.values() for i in range(len(space))[columns]}
    assert in_groups == set(range(len(space)))


def test_exactly_the_listed_parameters_move(prior):
    """Each listed parameter moves in some particle; the others stay bitwise identical to the initial pose."""
    pose = walk().poses[0]
    assert prior.parameters == tuple(name for name in POSE_NAMES if name in prior.parameters)
    moving = np.isin(POSE_NAMES, prior.parameters)
    poses = [prior.pose(state) for state in run(prior, pose, 50, seed=1)]
    for samples in poses:
        assert (samples[:, ~moving] == pose[~moving]).all()
        assert (np.ptp(samples[:, moving], axis=0) > 0.0).all()
    for before, after in pairwise(poses):
        assert (before[:, moving] != after[:, moving]).any(axis=0).all()


def test_equal_seeds_give_equal_states_and_other_seeds_other_states(prior):
    first, repeated, other = (run(prior, walk().poses[0], 20, seed)[-1] for seed in (5, 5, 6))
    assert first.tobytes() == repeated.tobytes()
    assert (first != other).any()


def test_inputs_stay_unchanged(prior):
    rng, pose = generator(0), walk().poses[0].copy()
    state = prior.sample_initial(pose, 10, rng)
    original = state.copy()
    state.flags.writeable = pose.flags.writeable = False
    prior.pose(prior.sample_transition(state, DT, rng))
    if isinstance(prior, Proposing):
        prior.propose(state, DT, rng)
    assert (state == original).all()
    assert (pose == walk().poses[0]).all()


def test_initial_samples_have_the_pose_as_their_mean(prior):
    """Except uniform parameters; 0.1 bounds the bias of a cyclic model and of truncation at joint limits."""
    pose = walk().poses[0]
    poses = prior.pose(prior.sample_initial(pose, MANY, generator(1)))
    bias = np.abs(poses.mean(axis=0) - pose)
    normal = [i for i, name in enumerate(POSE_NAMES) if name != "left_shoulder_twist"]
    assert (bias[normal] <= 5 * poses.std(axis=0)[normal] / np.sqrt(MANY) + 0.1).all()


def test_a_pose_depends_only_on_its_own_state(prior):
    state = run(prior, walk().poses[0], 6, seed=4)[-1]
    for i in range(6):
        assert (prior.pose(state[i : i + 1])[0] == prior.pose(state)[i]).all()


def test_transitions_do_not_depend_on_the_order_of_particles(prior):
    """Children of identical parents are identically distributed in both halves of the array."""
    poses = prior.pose(children(prior)[1])
    halves = poses[: MANY // 2], poses[MANY // 2 :]
    error = poses.std(axis=0) * np.sqrt(4 / MANY)
    assert (np.abs(halves[0].mean(axis=0) - halves[1].mean(axis=0)) <= 5 * error + 1e-12).all()


@only(WITH_ROOT)
def test_the_mean_root_displacement_is_proportional_to_time(prior):
    """Within 25 %, because speeds may change between frames; this excludes ratios of 1, √2 and 4."""
    distances = []
    for dt_s in (DT, 2 * DT):
        parent, state = children(prior, dt_s)
        distances.append(np.linalg.norm((prior.pose(state) - prior.pose(parent)).mean(axis=0)[:3]))
    assert distances[1] / distances[0] == pytest.approx(2.0, rel=0.25)


@only(WITH_NOISE_ALONE)
def test_noise_grows_with_the_square_root_of_time(prior):
    once, twice = (children(prior, dt_s)[1] for dt_s in (DT, 2 * DT))
    noisy = np.ptp(once, axis=0) > 0.0
    assert noisy.any()
    # the ratio of two standard deviations has a relative standard error of 1/√MANY
    ratios = twice.std(axis=0)[noisy] / once.std(axis=0)[noisy]
    assert ratios == pytest.approx(np.sqrt(2.0), rel=5 / np.sqrt(MANY))


def test_exactly_the_listed_priors_have_a_density(request, prior):
    assert (prior.capabilities.density is not None) == (request.node.callspec.params["prior"] in WITH_DENSITY)


def family(prior, n=20):
    """Return n states, their children and the transition density."""
    *_, parents, children = run(prior, walk().poses[0], n, seed=2, n_steps=2)
    return parents, children, prior.capabilities.density


@only(WITH_DENSITY)
def test_a_density_is_finite_at_sampled_transitions_and_broadcasts(prior):
    parents, children, density = family(prior)
    free = density.free
    assert (np.diff(free) > 0).all()
    assert 0 <= free[0] <= free[-1] < len(prior.space)
    log_density = density.log_transition(parents, children, DT)
    assert log_density.shape == (20,)
    assert np.isfinite(log_density).all()
    table = density.log_transition(parents[None], children[:7, None], DT)
    assert table.shape == (7, 20)
    np.testing.assert_allclose(table[range(7), range(7)], log_density[:7], rtol=1e-9)
    assert density.mean(parents, DT).shape == parents.shape
    assert np.isfinite(density.mean(parents, DT)).all()


@only(WITH_DENSITY)
def test_a_density_uses_only_free_columns_and_the_others_are_sampled_from_them(prior):
    parents, children, density = family(prior)
    dependent = np.setdiff1d(np.arange(len(prior.space)), density.free)
    incomplete = children.copy()
    incomplete[:, dependent] = np.nan
    incomplete.flags.writeable = parents.flags.writeable = False
    log_density = density.log_transition(parents, incomplete, DT)
    assert (log_density == density.log_transition(parents, children, DT)).all()
    completed = density.sample_dependent(parents, incomplete, DT, generator(4))
    assert (completed[:, density.free] == children[:, density.free]).all()
    assert np.isfinite(completed).all()
    assert (density.sample_dependent(parents, incomplete, DT, generator(4)) == completed).all()


@only(WITH_DENSITY)
def test_columns_without_noise_have_density_zero_elsewhere(prior):
    parents, children, density = family(prior)
    still = [i for i in density.free if (children[:, i] == parents[:, i]).all()]
    assert still or set(prior.parameters) == {*POSE_NAMES}
    for column in still:
        moved = children.copy()
        moved[:, column] += 0.5
        assert (density.log_transition(parents, moved, DT) == -np.inf).all()
