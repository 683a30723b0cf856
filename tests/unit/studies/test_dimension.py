"""Number of particles by dimension: survival and Kalman filter against direct computations, α of known laws."""

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.studies.dimension import (
    ANGLES,
    INDEPENDENT,
    NEEDED,
    ONE_FRAME,
    BodyAngles,
    IndependentAngles,
    ParticlesByDimension,
    fitted_alpha,
    paper_alpha,
    run_filter,
)

TRANSITION = np.array([[1.0, 1.0], [0.0, 1.0]])


def rng(seed=3):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def result():
    study = ParticlesByDimension(dims=(1, 2), dims_body=(1, 2), max_particles=1 << 11, n_frames=10, n_seeds=3)
    return study.run(rng())


def test_the_predicted_covariance_is_that_of_a_converged_kalman_filter():
    problem = IndependentAngles(1, jerk=0.5)
    noise = 0.25 * np.outer([0.5, 1.0], [0.5, 1.0])
    p = np.eye(2)
    for _ in range(200):
        p = TRANSITION @ (p - np.outer(p[:, 0], p[0]) / (p[0, 0] + 1.0)) @ TRANSITION.T + noise
    assert problem.predicted == pytest.approx(p)
    samples = problem.sample_transition(problem.sample_initial(200_000, rng()), rng(4))
    assert np.cov(samples.T) == pytest.approx(p, abs=0.02)  # the standard error of a variance of 0.9 is 0.003


def test_the_exact_survival_is_that_of_sampling():
    """E[w]² / E[w²] by samples from the prediction, over innovations with the filter's variance."""
    problem = IndependentAngles(1)
    s2 = problem.predicted[0, 0]
    samples = np.sqrt(s2) * rng().standard_normal(20_000)
    innovations = np.sqrt(s2 + 1.0) * rng(5).standard_normal(500)
    weights = np.exp(-0.5 * (innovations[:, None] - samples) ** 2)
    log_rates = 2.0 * np.log(weights.mean(axis=1)) - np.log((weights**2).mean(axis=1))
    assert log_rates.mean() == pytest.approx(problem.log_alpha, abs=3.0 * log_rates.std() / np.sqrt(500))


@pytest.mark.parametrize("d", [1, 3])
def test_many_particles_have_the_exact_survival_and_agree_with_the_kalman_filter(d):
    problem = IndependentAngles(d)
    runs = [run_filter(problem, 1 << 13, 20, rng(seed)) for seed in range(4)]
    log_rates = np.log([run.survival for run in runs])
    tolerance = 3.0 * log_rates.std() / np.sqrt(log_rates.size)
    assert log_rates.mean() == pytest.approx(d * problem.log_alpha, abs=tolerance)
    for run in runs:
        assert run.expected == pytest.approx(problem.exact(run.observed), abs=0.35 * np.sqrt(problem.filtered[0, 0]))


def test_only_the_first_d_angles_move():
    assert len(set(ANGLES)) == 16
    problem = BodyAngles(5, 4.0)
    state = problem.sample_transition(problem.sample_initial(50, rng()), rng(4))
    poses = problem.prior.pose(state)
    moving = np.ptp(poses, axis=0) > 0.0
    assert {name for name, moves in zip(POSE_NAMES, moving, strict=True) if moves} == set(ANGLES[:5])
    assert problem.observed(state) == pytest.approx(2.0 * BodyAngles(5, 8.0).observed(state))


def test_alpha_is_that_of_a_law_and_of_the_papers_numbers():
    x = np.array([1.0, 2.0, 4.0, 7.0])
    log_n = 0.7 - x * np.log10(0.4)
    assert fitted_alpha(x, log_n) == pytest.approx(0.4)
    log_n[2] = np.nan
    assert fitted_alpha(x, log_n) == pytest.approx(0.4)
    assert np.isnan(fitted_alpha(x[:1], log_n[:1]))
    assert 3.0e3 * paper_alpha() ** -21 == pytest.approx(1.0e16)  # 42 more parameters, 21 angles


def test_more_angles_need_more_particles(result):
    (figure,) = result.figures
    for name in (INDEPENDENT, NEEDED):
        assert (np.diff(figure.curves[name]) > 0.0).all()
    assert (figure.curves[NEEDED] > figure.curves[ONE_FRAME]).all()  # errors propagate to later frames
    seeds = np.array([row for name, row in figure.faint.items() if name.startswith(INDEPENDENT)])
    assert seeds.shape == (3, 2)
    assert figure.curves[INDEPENDENT] == pytest.approx(seeds.mean(axis=0))
    metrics = result.metrics
    assert metrics["alpha_independent"] == pytest.approx(metrics["alpha_exact"], abs=0.15)
    assert metrics["alpha_independent_low"] <= metrics["alpha_independent"] <= metrics["alpha_independent_high"]
    assert 0.0 < metrics["alpha_body"] <= 1.0


def test_alpha_is_nan_if_too_few_particles_survive():
    study = ParticlesByDimension(dims=(1, 2), dims_body=(1, 2), max_particles=256, n_frames=2, n_seeds=2)
    assert np.isnan(study.run(rng()).metrics["alpha_independent"])
