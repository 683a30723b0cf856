"""The iterated extended Kalman filter: exact for linear Gaussian models, and its refusals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stub_likelihoods import StubFrameLikelihood

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.filter_state import ResumePoint
from workbench.core.frame import Frame
from workbench.core.likelihood import Derivatives
from workbench.core.pose_prior import PosePrior
from workbench.inference.ekf.iterated_ekf import IteratedEkf
from workbench.inference.ekf.levenberg_marquardt import find_mode, heavy_tailed_prior
from workbench.likelihoods.uniform import Uniform
from workbench.motion.models.linear_motion import LinearMotion
from workbench.priors.linear import Linear
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

N = len(POSE_NAMES)
SIGMA = 0.02
PERSON = person_skeleton(from_height(1.75))
BODY = SimpleNamespace(
    skeleton=SimpleNamespace(
        limits=np.tile([-1e6, 1e6], (N, 1)), dof_names=POSE_NAMES, names=PERSON.names, parents=PERSON.parents,
        dof_joints=PERSON.dof_joints,
    )
)  # fmt: skip
DT_S = 1.0 / 30.0


def model(rng):
    mixed = 0.05 * rng.standard_normal((N, N))
    gain = np.concatenate([-0.1 * rng.random((N, N - 4)), 0.9 * np.eye(N) + 0.01 * rng.standard_normal((N, N))], axis=1)
    gain[3] = 0.0  # nobody turns, so that all is linear
    covariance = mixed @ mixed.T + 0.01 * np.eye(N)
    covariance[3], covariance[:, 3] = 0.0, 0.0
    covariance[3, 3] = 1e-12
    start = np.diag(np.full(N, 0.04))
    start[3, 3] = 1e-12
    return LinearMotion(30.0, gain, np.zeros(N), covariance, np.zeros((N, N - 4)), np.zeros(N), start)


class Seen(StubFrameLikelihood):
    """A likelihood that sees every number of a pose with noise, but for the first frame; its misfit widens nothing."""

    n_levels, informative = 1, False

    def __init__(self, marks, frame=None):
        self.marks, self.at = marks, frame

    def prepare(self, previous, frame):
        return type(self)(self.marks, frame.index)

    def derivatives(self, pose, level):
        miss = (pose - self.marks[self.at]) / SIGMA
        return Derivatives(-0.5 * float(miss @ miss), -miss / SIGMA, np.eye(N) / SIGMA**2)

    def mean_loss(self, pose):
        return np.full(len(PERSON.names), 0.7)


def setting(n_frames=6):
    rng = np.random.default_rng(1)
    prior = Linear(model(rng))
    state = prior.sample_initial(np.zeros(N), 1, rng)
    marks = [state[0, :N]]
    for _ in range(n_frames - 1):
        state = prior.sample_transition(state, DT_S, rng)
        marks.append(state[0, :N] + SIGMA * rng.standard_normal(N))
    frames = [Frame(k, k * DT_S, (), None) for k in range(n_frames)]
    return prior, np.array(marks), frames


def exact(prior, marks):
    """Mean of all poses (F, N) given the marks of all frames but the first, as one Gaussian."""
    mean, covariance = prior.initial_moments(np.zeros(N))
    unit = np.eye(2 * N)
    lead = (prior.mean(unit, DT_S) - prior.mean(np.zeros((1, 2 * N)), DT_S)).T
    noise, d, frames = prior.noise_covariance(np.zeros(2 * N), DT_S), 2 * N, len(marks)
    means, joint = [mean], np.zeros((frames * d, frames * d))
    joint[:d, :d] = covariance
    for t in range(1, frames):
        now, before = slice(t * d, (t + 1) * d), slice((t - 1) * d, t * d)
        means.append(prior.mean(means[-1][None], DT_S)[0])
        joint[now, : t * d] = lead @ joint[before, : t * d]
        joint[: t * d, now] = joint[now, : t * d].T
        joint[now, now] = lead @ joint[before, before] @ lead.T + noise
    looked = np.concatenate([t * d + np.arange(N) for t in range(1, frames)])
    gain = joint[:, looked] @ np.linalg.inv(joint[np.ix_(looked, looked)] + SIGMA**2 * np.eye(len(looked)))
    told = np.concatenate(means) + gain @ (marks[1:].ravel() - np.concatenate(means)[looked])
    left = joint - gain @ joint[looked]
    return told.reshape(frames, d)[:, :N], np.diag(left).reshape(frames, d)[:, :N]


def run(filter_, frames, seed=0):
    streams = {name: np.random.default_rng([seed, k]) for k, name in enumerate(("resampling", "prior"))}
    return list(filter_.run(frames, np.zeros(N), streams))


def test_both_passes_are_exact_where_all_is_linear_and_gaussian():
    prior, marks, frames = setting()
    steps = run(
        IteratedEkf(prior, Seen(marks), BODY, curvature_weight=1.0, outlier_motion_probability=1e-12, n_particles=4000),
        frames,
    )
    means, variances = exact(prior, marks)
    told = np.array([step.expected_pose for step in steps])
    assert np.abs(told - means).max() < 2e-4
    spread = np.array([step.poses.std(axis=0) for step in steps])
    assert np.allclose(spread, np.sqrt(variances), rtol=0.06, atol=2e-4)  # 4000 draws: 1.1 %, four of 150 deviations
    forwards = run(
        IteratedEkf(
            prior, Seen(marks), BODY, curvature_weight=1.0, outlier_motion_probability=1e-12, second_pass=False
        ),
        frames,
    )
    assert np.abs(forwards[-1].expected_pose - means[-1]).max() < 2e-4
    assert np.abs(forwards[1].expected_pose - means[1]).max() > 1e-3  # which knows nothing of later frames


@pytest.mark.slow
def test_what_is_told_is_drawn_to_the_postures_that_people_take_and_tracking_is_as_before():
    prior, marks, frames = setting()
    taken = PosePrior(np.ones(1), np.full((1, N - 4), 0.5), 0.01 * np.eye(N - 4)[None])
    drawn = Linear(replace(prior.model, pose_prior=taken))
    options = {"curvature_weight": 1.0, "outlier_motion_probability": 1e-12, "n_particles": 40_000}
    before = run(IteratedEkf(drawn, Seen(marks), BODY, **options), frames)
    after = run(IteratedEkf(drawn, Seen(marks), BODY, pose_prior_power=0.3, **options), frames)
    for plain, told in zip(before, after, strict=True):
        covariance = np.cov(plain.poses.T)
        pose, narrowed = taken.geometric_product(plain.expected_pose, covariance, 0.3)
        missed = np.linalg.norm(told.expected_pose - pose)  # as a covariance of draws is off by a hundredth
        assert missed < 0.1 * np.linalg.norm(plain.expected_pose - pose)
        assert np.allclose(told.poses[:, 4:].std(axis=0), np.sqrt(np.diag(narrowed))[4:], rtol=0.1)
        assert told.log_evidence == plain.log_evidence
    unlearned = run(IteratedEkf(prior, Seen(marks), BODY, pose_prior_power=0.3, **options), frames)
    assert all((a.poses == b.poses).all() for a, b in zip(unlearned, before, strict=True))


class Otherwise(Seen):
    """A likelihood that sees its marks elsewhere when it looks again."""

    def refitted(self, frame, poses):
        return Seen(self.marks + 0.02)


def test_two_looks_are_two_samples_of_what_a_look_may_find():
    prior, marks, frames = setting()
    options = {"curvature_weight": 1.0, "outlier_motion_probability": 1e-12, "n_particles": 40_000}
    first, second = (run(IteratedEkf(prior, Seen(at), BODY, **options), frames) for at in (marks, marks + 0.02))
    both = run(IteratedEkf(prior, Otherwise(marks), BODY, **options), frames)
    for one, two, told in zip(first, second, both, strict=True):
        apart = one.expected_pose - two.expected_pose
        assert np.allclose(told.expected_pose, 0.5 * (one.expected_pose + two.expected_pose), atol=2e-4)
        expected = np.cov(two.poses.T) + 0.5 * np.outer(apart, apart)
        assert np.allclose(np.cov(told.poses.T), expected, atol=0.05 * expected.diagonal().max())
    assert np.abs(apart[:5]).max() > 1e-3


def test_steps_come_as_frames_do_without_a_second_pass():
    prior, marks, frames = setting()
    seen = []

    def asked():
        for frame in frames:
            seen.append(frame.index)
            yield frame

    streams = {name: np.random.default_rng(0) for name in ("resampling", "prior")}
    steps = IteratedEkf(prior, Seen(marks), BODY, second_pass=False).run(asked(), np.zeros(N), streams)
    next(steps)
    assert seen == [0]


def test_no_gaussian_prior_and_no_start_are_refused():
    prior, marks, frames = setting()
    with pytest.raises(InputError, match="needs a pose to start from"):
        list(IteratedEkf(prior, Seen(marks), BODY).run(frames, None, {}))
    with pytest.raises(InputError, match="needs a prior with Gaussian noise"):
        list(IteratedEkf(Smooth(parameters=["left_arm"]), Seen(marks), BODY).run(frames, np.zeros(N), {}))
    with pytest.raises(InputError, match="needs a likelihood with derivatives by the pose, found Uniform"):
        list(IteratedEkf(prior, Uniform(), BODY).run(frames, np.zeros(N), {}))


def test_constant_velocity_is_a_gaussian_prior():
    """Its moments are those of what it draws, where no limit is near."""
    prior, rng = Smooth(), np.random.default_rng(0)
    middle = np.zeros(N)
    middle[6:] = 0.5 * (prior.limits[6:].sum(axis=1))
    mean, covariance = prior.initial_moments(middle)
    drawn = prior.sample_initial(middle, 20000, rng)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=5.0 * np.sqrt(np.diag(covariance) / 20000).max())
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.05)
    state = np.concatenate([middle, np.zeros(N)])
    noise = prior.noise_covariance(state, DT_S)
    stepped = prior.sample_transition(np.repeat(state[None], 20000, axis=0), DT_S, rng)
    np.testing.assert_allclose(stepped.std(axis=0), np.sqrt(np.diag(noise)), rtol=0.05)
    assert np.count_nonzero(noise - np.diag(np.diag(noise))) == 0


class Bowl(StubFrameLikelihood):
    """A look whose log likelihood is that of seeing every number at `marks` (P,) with noise, at two smoothings."""

    def __init__(self, marks, sigma):
        self.marks, self.sigma = marks, sigma

    def derivatives(self, pose, level):
        apart = (pose - self.marks) / self.sigma
        return Derivatives(-0.5 * float(apart @ apart), -apart / self.sigma, np.eye(len(pose)) / self.sigma**2)


def spread(rng, n=4):
    root = rng.standard_normal((n, n))
    return 0.01 * root @ root.T + 0.001 * np.eye(n)


def test_with_thin_tails_the_climb_ends_at_the_gaussian_posterior():
    rng = np.random.default_rng(2)
    mean, covariance, marks = rng.standard_normal(4), spread(rng), rng.standard_normal(4)
    free = np.tile([-1e6, 1e6], (4, 1))
    mode = find_mode(
        Bowl(marks, 0.2),
        mean,
        covariance,
        free,
        start=mean,
        limbs=np.array([0, 0, 1, 1]),
        outlier_motion_probability=1e-12,
        curvature_weight=1.0,
    )
    precision = np.linalg.inv(covariance)
    expected = np.linalg.inv(precision + np.eye(4) / 0.04)
    np.testing.assert_allclose(mode.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(mode.pose, expected @ (precision @ mean + marks / 0.04), atol=1e-5)
    apart = marks - mean
    total = covariance + 0.04 * np.eye(4)
    height = -0.5 * apart @ np.linalg.solve(total, apart) - 0.5 * np.linalg.slogdet(total / 0.04)[1]
    assert mode.log_evidence == pytest.approx(height, abs=1e-4)  # but for the bowl's constant


def test_a_limb_that_moves_suddenly_is_let_go_alone():
    mean, covariance, marks = np.zeros(4), 1e-4 * np.eye(4), np.array([0.1, 0.1, 0.01, 0.0])  # ten deviations
    free, limbs = np.tile([-1e6, 1e6], (4, 1)), np.array([0, 0, 1, 1])
    sudden, steady = (
        find_mode(
            Bowl(marks, 0.01),
            mean,
            covariance,
            free,
            start=mean,
            limbs=limbs,
            outlier_motion_probability=sudden,
            curvature_weight=1.0,
        )
        for sudden in (0.05, 1e-12)
    )
    np.testing.assert_allclose(steady.pose, 0.5 * marks, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(sudden.pose[:2], 0.09, rtol=1e-2)  # nine tenths, as of a deviation three times as wide
    np.testing.assert_allclose(sudden.pose[2:], 0.5 * marks[2:], rtol=0.03, atol=1e-6)
    assert sudden.covariance[0, 0] > 1.5 * steady.covariance[0, 0]
    np.testing.assert_allclose(sudden.covariance[2, 2], steady.covariance[2, 2], rtol=0.03)


def test_the_precision_of_tails_is_their_slope():
    rng = np.random.default_rng(5)
    prior = heavy_tailed_prior(rng.standard_normal(4), spread(rng), np.array([0, 0, 1, 1]), 0.05)
    for far in (0.1, 0.3, 1.0):
        pose = prior.mean + far * rng.standard_normal(4)
        slope = -prior.precision(pose) @ (pose - prior.mean)
        steps = 1e-6 * np.eye(4)
        expected = [(prior.log_density(pose + step) - prior.log_density(pose - step)) / 2e-6 for step in steps]
        np.testing.assert_allclose(slope, expected, rtol=1e-4)
    assert prior.log_density(prior.mean) == 0.0


def test_a_climb_stays_within_limits():
    limits = np.array([[-0.1, 0.1]] * 4)
    mode = find_mode(
        Bowl(np.full(4, 3.0), 0.1),
        np.zeros(4),
        0.04 * np.eye(4),
        limits,
        start=np.zeros(4),
        limbs=np.arange(4),
        outlier_motion_probability=0.05,
        curvature_weight=1.0,
    )
    assert (np.abs(mode.pose) <= 0.1).all()


class Misfit(Seen):
    """Knows its slope, and fits what the left knee moves badly, or nothing."""

    informative = True

    def __init__(self, marks, knee, frame=None):
        super().__init__(marks, frame)
        self.knee = knee

    def prepare(self, previous, frame):
        return Misfit(self.marks, self.knee, frame.index)

    def mean_loss(self, pose):
        return np.where(np.array(PERSON.names) == "left_knee", self.knee, 0.7)


def test_what_fits_badly_is_told_with_wider_bands_about_the_same_pose():
    (prior, marks, frames), body = setting(), SimpleNamespace(skeleton=PERSON)
    well, badly = (
        run(IteratedEkf(prior, Misfit(marks, knee), body, n_particles=20000), frames)[-1] for knee in (0.7, 3.7)
    )
    wider = badly.poses.std(axis=0) / well.poses.std(axis=0)
    expected = np.where(np.array(POSE_NAMES) == "left_knee_flexion", 4.0, 1.0)
    np.testing.assert_allclose(wider, expected, rtol=0.05)  # of 20000 draws: six deviations
    np.testing.assert_allclose(badly.expected_pose, well.expected_pose, atol=1e-12)


def test_it_goes_on_from_any_frame_to_the_same_bits():
    prior, marks, frames = setting()
    kalman = IteratedEkf(prior, Seen(marks), BODY, second_pass=False, n_particles=10)
    whole = list(kalman.run(frames, marks[0], rng_streams(0)))
    assert kalman.resumable
    for k in range(1, len(frames)):
        past = ResumePoint(np.stack([step.filter_state.filtered_pose for step in whole[:k]]), whole[k - 1].filter_state)
        found = list(kalman.run(frames, past, rng_streams(7)))
        assert len(found) == len(frames) - k
        for one, other in zip(found, whole[k:], strict=True):
            np.testing.assert_array_equal(one.particles, other.particles)
            np.testing.assert_array_equal(
                one.filter_state.arrays["covariance"], other.filter_state.arrays["covariance"]
            )
            assert one.log_evidence == other.log_evidence
    both = IteratedEkf(prior, Seen(marks), BODY)
    assert not both.resumable
    with pytest.raises(InputError, match="second_pass=false"):
        list(both.run(frames, past, rng_streams(0)))
