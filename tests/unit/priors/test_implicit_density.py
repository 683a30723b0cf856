"""The implicit prior's density against enumeration, integration and its own samples."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from tests.oracles import implicit as oracle
from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import MAX_EXAMPLES, Implicit
from workbench.priors.implicit_density import WindowDisplacements, log_mixture
from workbench.priors.implicit_search import exact_log_prob, kd_tree, nearest_entries
from workbench.utils.errors import InputError

DT, P, N = 1 / 30, len(POSE_NAMES), 20_000
ELBOW = POSE_NAMES.index("left_elbow_flexion")
WARM = {"beta": 0.5, "sigma_angles": 0.05}  # so that several windows could have led to a pose


@pytest.fixture(scope="module")
def motions():
    return builtin_motions(n_subjects=2)


@pytest.fixture(scope="module")
def poses(motions):
    return motions[1].resampled(30.0).poses


@pytest.fixture(scope="module")
def elbow(motions):
    """Windows of one angle."""
    return learn_windows(motions, angles=["left_elbow_flexion"], include_root=False, window_frames=4)


@pytest.fixture(scope="module")
def body(motions):
    return learn_windows(motions)


def parent(prior, poses, n=1):
    return prior.start_after(poses[20 : 21 + prior.windows.window_frames] + 0.01, n)


@pytest.mark.parametrize("still", [0, 2])
def test_the_kernel_agrees_with_numpy(still):
    """In columns without noise a window leads to the pose exactly or not at all."""
    rng = np.random.default_rng(0)
    coefficients, white = rng.normal(size=(900, 5)).astype(np.float32), rng.normal(size=(900, 6))
    white[:, 6 - still :] = np.round(white[:, 6 - still :])
    displacements = WindowDisplacements(white, np.arange(6), np.linspace(0.1, 0.5, 6 - still))
    tree = kd_tree(coefficients)
    probes = rng.normal(size=(7, 5))[np.array([0, 1, 0, 2, 3, 4, 5, 0, 6, 6])]
    targets = white[rng.integers(900, size=10)] + 0.3 * rng.normal(size=(10, 6)) * (np.arange(6) < 6 - still)
    density, _ = log_mixture(tree, probes, 0.3, 0.01, displacements, targets)
    pairs = zip(probes, targets, strict=True)
    terms = [oracle.log_mixture(tree, probe, 0.3, 0.01, displacements, target) for probe, target in pairs]
    expected = [logsumexp(row) for row in terms]
    assert density == pytest.approx(expected, rel=1e-4, abs=1e-3)  # the search's distances are float32, over 2β
    assert np.isfinite(expected).any()


def test_windows_are_sampled_by_the_mixtures_responsibilities():
    rng = np.random.default_rng(1)
    coefficients, white = rng.normal(size=(60, 3)).astype(np.float32), rng.normal(size=(60, 2))
    displacements, tree = WindowDisplacements(white, np.arange(2), np.ones(2)), kd_tree(coefficients)
    probe, targets = np.array([[0.2, -0.1, 0.4]]), np.array([[0.3, 0.8]])
    terms = oracle.log_mixture(tree, probe[0], 1.0, 1e-6, displacements, targets[0])
    p = np.exp(terms - logsumexp(terms))
    _, entries = log_mixture(
        tree, np.repeat(probe, N, axis=0), 1.0, 1e-6, displacements, np.repeat(targets, N, axis=0), rng.random(N)
    )
    frequencies = np.bincount(entries, minlength=60) / N
    assert (np.abs(frequencies - p) <= 5 * np.sqrt(p * (1 - p) / N) + 1e-12).all()
    assert (p > 0.01).sum() > 5


@pytest.mark.parametrize("prediction", ["copy", "increment", "blend"])
def test_the_density_of_one_angle_integrates_to_one_and_is_the_mixture_of_all_windows(elbow, poses, prediction):
    prior = Implicit(elbow, prediction=prediction, tail_probability=0.01, **WARM)
    before = parent(prior, poses)
    grid = np.linspace(-2.0, 4.0, 6001)
    states = np.repeat(before, len(grid), axis=0)
    states[:, ELBOW] = grid
    density = np.exp(prior.capabilities.density.log_transition(before, states, DT))
    assert density.sum() * (grid[1] - grid[0]) == pytest.approx(1.0, abs=1e-6)
    entries = np.arange(len(elbow))
    p = np.exp(exact_log_prob(elbow.coefficients, before[0, prior.space.slices["coefficients"]], prior.beta))
    means = prior.predict(np.repeat(before, len(elbow), axis=0), entries, np.zeros((len(elbow), P)))[:, ELBOW]
    exact = (p[:, None] * norm.pdf(grid, means[:, None], 0.05)).sum(axis=0)
    total_variation = 0.5 * np.abs(density - exact).sum() * (grid[1] - grid[0])
    assert total_variation <= 0.01


def test_memories_are_sampled_given_the_pose(elbow, poses):
    """Window i leaves its own memory and is drawn with a probability proportional to p(i | c) N(pose; m_i, σ²)."""
    prior = Implicit(elbow, tail_probability=1e-6, **WARM)
    before = parent(prior, poses)
    entries, n = np.arange(len(elbow)), len(elbow)
    means = prior.predict(np.repeat(before, n, axis=0), entries, np.zeros((n, P)))[:, ELBOW]
    after = before.copy()
    after[0, ELBOW] = np.median(means) + 0.04
    log_p = exact_log_prob(elbow.coefficients, before[0, prior.space.slices["coefficients"]], prior.beta)
    log_p += norm.logpdf(after[0, ELBOW], means, 0.05)
    p = np.exp(log_p - logsumexp(log_p))
    memories = prior.prediction.with_pose(np.repeat(before, n, axis=0), np.repeat(after[:, :P], n, axis=0), entries)
    completed = prior.capabilities.density.sample_dependent(
        np.repeat(before, N, axis=0), np.repeat(after, N, axis=0), DT, np.random.default_rng(0)
    )
    expected = p @ memories[:, P:]
    deviation = np.sqrt(p @ (memories[:, P:] - expected) ** 2)
    assert (np.abs(completed[:, P:].mean(axis=0) - expected) <= 5 * deviation / np.sqrt(N) + 1e-9).all()
    assert completed[:, P:].std(axis=0) == pytest.approx(deviation, rel=0.1, abs=1e-9)
    assert 1.0 / (p**2).sum() > 3.0


def test_the_state_at_a_predicted_pose_is_the_prediction(body, poses):
    prior, rng = Implicit(body), np.random.default_rng(3)
    before = parent(prior, poses, 50)
    entries = rng.integers(len(body), size=50)
    predicted = prior.predict(before, entries, rng.standard_normal((50, P)))
    at_pose = prior.prediction.with_pose(before, predicted[:, :P], entries)
    np.testing.assert_allclose(at_pose, predicted, rtol=1e-9, atol=1e-9)


def test_reweighted_children_of_a_body_have_the_moments_of_the_other_parents_children(body, poses):
    prior = Implicit(body, beta=0.5, sigma_position=(0.02, 0.01, 0.03), sigma_angles=0.1)
    first, other = parent(prior, poses), parent(prior, poses)
    other[:, :P] += np.array([0.005, -0.004, 0.01, 0.01, 0.005, -0.005, *np.full(19, 0.02)])
    density = prior.capabilities.density
    children = prior.sample_transition(np.repeat(first, N, axis=0), DT, np.random.default_rng(1))
    others = prior.sample_transition(np.repeat(other, N, axis=0), DT, np.random.default_rng(2))
    weights = np.exp(density.log_transition(other, children, DT) - density.log_transition(first, children, DT))
    mean = others[:, :P].mean(axis=0)
    for power in (0, 1, 2):
        weighted, plain = weights[:, None] * (children[:, :P] - mean) ** power, (others[:, :P] - mean) ** power
        error = np.sqrt((weighted.var(axis=0) + plain.var(axis=0)) / N)
        assert (np.abs(weighted.mean(axis=0) - plain.mean(axis=0)) <= 5 * error + 1e-9).all()


def test_the_mean_is_the_nearest_windows_prediction(body, poses):
    prior = Implicit(body)
    before = prior.sample_initial(poses[30], 8, np.random.default_rng(0))
    probes = before[:, prior.space.slices["coefficients"]]
    nearest = ((body.coefficients[None] - probes[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    assert (nearest_entries(prior.tree, probes, prior.beta) == nearest).all()
    expected = prior.predict(before, nearest, np.zeros((8, P)))
    assert (prior.capabilities.density.mean(before, DT) == expected).all()


def test_a_restricted_or_colder_prior_has_the_density_of_its_samples(elbow, poses):
    prior = Implicit(elbow, **WARM)
    before = parent(prior, poses)
    first_half = np.arange(len(elbow)) < len(elbow) // 2
    for other in (prior.only(first_half), prior.searching("exact", 0.01)):
        grid = np.repeat(before, 3001, axis=0)
        grid[:, ELBOW] = np.linspace(-1.0, 3.0, 3001)
        p = np.exp(other.capabilities.density.log_transition(before, grid, DT))
        drawn = other.sample_transition(np.repeat(before, N, axis=0), DT, np.random.default_rng(0))[:, ELBOW]
        mean = (p * grid[:, ELBOW]).sum() / p.sum()
        assert abs(drawn.mean() - mean) <= 5 * drawn.std() / np.sqrt(N)


def test_other_searches_have_no_density_and_other_rates_are_rejected(elbow, poses):
    for search in ("sign_tree", "median_tree"):
        assert Implicit(elbow, search=search).capabilities.density is None
    prior = Implicit(elbow)
    assert prior.searching("sign_tree", 0.1).capabilities.density is None
    before = parent(prior, poses)
    for evaluate in (
        lambda dt_s: prior.capabilities.density.mean(before, dt_s),
        lambda dt_s: prior.capabilities.density.log_transition(before, before, dt_s),
        lambda dt_s: prior.capabilities.density.sample_dependent(before, before, dt_s, np.random.default_rng(0)),
    ):
        with pytest.raises(InputError, match=r"2 rows .* whose density covers one"):
            evaluate(2 * DT)


def test_examples_are_poses_at_the_windows_ends(body, elbow):
    examples = Implicit(body).capabilities.examples()
    assert examples.shape == (min(len(body), MAX_EXAMPLES), P)
    assert (examples[:, :4] == 0.0).all()
    rows = body.rows[body.ends].astype(np.float64)
    np.testing.assert_array_equal(examples[:, 6:], rows[:, :19])
    np.testing.assert_array_equal(examples[:, 4:6], rows[:, 42:44])
    of_elbow = Implicit(elbow).capabilities.examples()
    assert (np.ptp(of_elbow, axis=0) > 0.0).nonzero()[0].tolist() == [ELBOW]


def test_many_examples_are_thinned_evenly(elbow):
    repeated = elbow.only(np.tile(np.arange(len(elbow)), 9))
    assert len(repeated) > MAX_EXAMPLES
    examples = Implicit(repeated).capabilities.examples()
    assert len(examples) == MAX_EXAMPLES
    ends = repeated.rows[repeated.ends, 0]
    assert (examples[0, ELBOW], examples[-1, ELBOW]) == (ends[0], ends[-1])
