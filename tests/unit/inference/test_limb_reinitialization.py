"""Limb reinitialization: accepted only for a limb that is elsewhere, and the Gaussian state after it."""

from types import SimpleNamespace

import numpy as np
import pytest
from stub_likelihoods import StubFrameLikelihood

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.frame import Frame
from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.gaussian_state import GaussianState, smooth_backward
from workbench.inference.ekf.iterated_ekf import IteratedEkf
from workbench.inference.ekf.limb_reinitialization import MIN_GAIN, is_better, reinitialization_cost, reinitialize_limb
from workbench.priors.smooth import Smooth
from workbench.utils.rng import stream

SKELETON = person_skeleton(from_height(1.75))
ARM = np.array([k for k, name in enumerate(SKELETON.dof_names) if name.startswith(("left_shoulder", "left_elbow"))])


class Image(StubFrameLikelihood):
    """Likeliest, by `height` nats, where the arm is at `place`; asked for the arm alone or for everything."""

    def __init__(self, place, height, wide=0.5):
        self.place, self.height, self.wide, self.asked = place, height, wide, []

    def compare(self, poses, moved):
        self.asked.append(moved)
        return self.height * np.exp(-0.5 * (((poses[:, ARM] - self.place) / self.wide) ** 2).sum(axis=1))


def standing():
    return np.clip(np.zeros(25), *SKELETON.limits.T)


def elsewhere(by=0.6):
    low, high = SKELETON.limits[ARM].T
    place = standing()[ARM]
    return np.where(high - place > place - low, np.minimum(place + by, high), np.maximum(place - by, low))


@pytest.mark.parametrize("seed", range(5))
def test_an_arm_that_is_elsewhere_is_found_there(seed):
    frame_likelihood = Image(elsewhere(), 80.0)
    assert isinstance(frame_likelihood, DenseLikelihood)
    found = reinitialize_limb(frame_likelihood, SKELETON, ARM, standing(), standing(), np.random.default_rng(seed))
    np.testing.assert_allclose(found[ARM], frame_likelihood.place, atol=0.3)
    others = np.setdiff1d(np.arange(25), ARM)
    np.testing.assert_array_equal(found[others], standing()[others])
    names = [SKELETON.names[k] for k in np.flatnonzero(frame_likelihood.asked[0])]
    assert names == ["left_shoulder", "left_elbow", "left_wrist"]


def test_an_arm_that_is_where_it_was_thought_to_be_stays():
    frame_likelihood = Image(standing()[ARM], 80.0, wide=0.1)
    assert reinitialize_limb(frame_likelihood, SKELETON, ARM, standing(), standing(), np.random.default_rng(0)) is None
    assert len(frame_likelihood.asked) == 1  # nowhere else is worth a closer look


def test_a_little_likelier_is_not_enough():
    place = elsewhere()
    least = MIN_GAIN + reinitialization_cost(place, standing()[ARM])
    rng = np.random.default_rng(0)
    assert reinitialize_limb(Image(place, 0.9 * least), SKELETON, ARM, standing(), standing(), rng) is None
    found = standing()
    found[ARM] = place
    for height, expected in ((1.1 * least, True), (0.9 * least, False)):
        frame_likelihood = Image(place, height, wide=0.05)
        assert is_better(frame_likelihood, len(SKELETON.names), standing(), found, ARM, standing()) is expected
        assert frame_likelihood.asked[0].all()


def test_what_is_found_is_within_the_limits():
    limits = SKELETON.limits[ARM]
    below, above = standing()[ARM] - limits[:, 0], limits[:, 1] - standing()[ARM]
    frame_likelihood = Image(np.where(below < above, limits[:, 0] - 0.3, limits[:, 1] + 0.3), 300.0, wide=1.0)
    found = reinitialize_limb(frame_likelihood, SKELETON, ARM, standing(), standing(), np.random.default_rng(0))
    assert found is not None
    assert ((found[ARM] >= limits[:, 0]) & (found[ARM] <= limits[:, 1])).all()


def test_the_past_says_nothing_of_what_leapt_and_all_of_the_rest():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    first = GaussianState(
        rng.standard_normal(4), root @ root.T, np.zeros(4), np.eye(4), np.eye(4), np.ones(len(POSE_NAMES))
    )
    covariance = first.covariance + np.eye(4)
    led = GaussianState(first.mean, covariance, first.mean, covariance, np.eye(4), first.std_inflation)
    known = np.array([1, 3])
    after = led.decoupled(known, np.array([5.0, 0.0]), np.array([0.2, 3.0]))
    np.testing.assert_array_equal(after.mean[known], [5.0, 0.0])
    np.testing.assert_allclose(np.diag(after.covariance)[known], [0.04, 9.0])
    rest = np.array([0, 2])
    assert not after.covariance[np.ix_(known, rest)].any()
    np.testing.assert_array_equal(after.covariance[np.ix_(rest, rest)], covariance[np.ix_(rest, rest)])
    moved = after.mean.copy()
    moved[known] += 10.0  # seen where it leapt to, which tells nothing of where it was
    seen = GaussianState(
        moved, 0.5 * after.covariance, after.predicted, after.predicted_covariance, after.transition, led.std_inflation
    )
    back = smooth_backward([first, seen])[0]
    np.testing.assert_allclose(back.mean, first.mean, atol=1e-9)


class Likelihood(Image):
    """One whose look is the same in every frame, and that notes in which of them a single limb was asked about."""

    def __init__(self):
        super().__init__(elsewhere(), 80.0)
        self.frame, self.leapt = None, set()

    def prepare(self, previous, frame):
        self.frame = frame.index
        return self

    def compare(self, poses, moved):
        if not moved.all():
            self.leapt.add(self.frame)
        return super().compare(poses, moved)

    def derivatives(self, pose, level, derive=True):
        return Derivatives(0.0, np.zeros(len(pose)), np.eye(len(pose)))


def test_nobody_leaps_from_where_the_start_is_given():
    likelihood, frames = Likelihood(), [Frame(k, k / 30.0, (), None) for k in range(3)]
    body = SimpleNamespace(skeleton=SKELETON)
    filtered = IteratedEkf(Smooth(), likelihood, body, n_particles=2, second_pass=False)
    streams = {name: stream(0, name) for name in ("resampling", "prior")}
    assert len(list(filtered.run(frames, standing(), streams))) == 3
    assert likelihood.leapt == {1, 2}
