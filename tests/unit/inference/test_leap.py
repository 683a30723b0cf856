"""Leaps: a limb that is somewhere else is found and taken, and no other; and what is believed after one."""

from types import SimpleNamespace

import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.likelihood import LayeredLook
from workbench.inference.kalman.belief import Belief, smoothed
from workbench.inference.kalman.leap import LEAST_GAIN, MOST_LOSS, cost, is_better, leap

SKELETON = person_skeleton(from_height(1.75))
ARM = np.array([k for k, name in enumerate(SKELETON.dof_names) if name.startswith(("left_shoulder", "left_elbow"))])


class Image:
    """Likeliest, by `height` nats, where the arm is at `place`; asked for the arm alone or for everything."""

    levels, judges, notes, diagnostics = 2, True, (), {}

    def __init__(self, place, height, wide=0.5, points=0.0):
        self.place, self.height, self.wide, self.points, self.asked = place, height, wide, points, []

    def compare(self, poses, moved):
        self.asked.append(moved)
        return self.height * np.exp(-0.5 * (((poses[:, ARM] - self.place) / self.wide) ** 2).sum(axis=1))

    def slope(self, pose, level, derive=True):
        assert level == self.levels - 1
        return SimpleNamespace(log_prob=self.points * float(np.abs(pose[ARM] - self.place).max() < 0.5))

    def misfit(self, pose):
        raise AssertionError

    evaluate = remember = misfit


def standing():
    return np.clip(np.zeros(25), *SKELETON.limits.T)


def elsewhere(by=0.6):
    low, high = SKELETON.limits[ARM].T
    place = standing()[ARM]
    return np.where(high - place > place - low, np.minimum(place + by, high), np.maximum(place - by, low))


@pytest.mark.parametrize("seed", range(5))
def test_an_arm_that_is_elsewhere_is_found_there(seed):
    look = Image(elsewhere(), 80.0)
    assert isinstance(look, LayeredLook)
    found = leap(look, SKELETON, ARM, standing(), standing(), np.random.default_rng(seed))
    np.testing.assert_allclose(found[ARM], look.place, atol=0.3)
    others = np.setdiff1d(np.arange(25), ARM)
    np.testing.assert_array_equal(found[others], standing()[others])
    names = [SKELETON.names[k] for k in np.flatnonzero(look.asked[0])]
    assert names == ["left_shoulder", "left_elbow", "left_wrist"]


def test_an_arm_that_is_where_it_was_thought_to_be_stays():
    look = Image(standing()[ARM], 80.0)
    assert leap(look, SKELETON, ARM, standing(), standing(), np.random.default_rng(0)) is None


def test_a_little_likelier_is_not_enough():
    place = elsewhere()
    least = LEAST_GAIN + cost(place, standing()[ARM])
    rng = np.random.default_rng(0)
    assert leap(Image(place, 0.9 * least), SKELETON, ARM, standing(), standing(), rng) is None
    found = standing()
    found[ARM] = place
    for height, points, expected in (
        (1.1 * least, 0.0, True), (0.9 * least, 0.0, False), (1.1 * least, -1.1 * MOST_LOSS, False),
        (1.1 * least, -0.9 * MOST_LOSS, True),
    ):  # fmt: skip
        look = Image(place, height, wide=0.05, points=points)
        assert is_better(look, len(SKELETON.names), standing(), found, ARM, standing()) is expected
        assert look.asked[0].all()


def test_what_is_found_is_within_the_limits():
    limits = SKELETON.limits[ARM]
    below, above = standing()[ARM] - limits[:, 0], limits[:, 1] - standing()[ARM]
    look = Image(np.where(below < above, limits[:, 0] - 0.3, limits[:, 1] + 0.3), 300.0, wide=1.0)
    found = leap(look, SKELETON, ARM, standing(), standing(), np.random.default_rng(0))
    assert found is not None
    assert ((found[ARM] >= limits[:, 0]) & (found[ARM] <= limits[:, 1])).all()


def test_the_past_says_nothing_of_what_leapt_and_all_of_the_rest():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    first = Belief(rng.standard_normal(4), root @ root.T, np.zeros(4), np.eye(4), np.eye(4), np.ones(len(POSE_NAMES)))
    covariance = first.covariance + np.eye(4)
    led = Belief(first.mean, covariance, first.mean, covariance, np.eye(4), first.doubt)
    known = np.array([1, 3])
    after = led.released(known, np.array([5.0, 0.0]), np.array([0.2, 3.0]))
    np.testing.assert_array_equal(after.mean[known], [5.0, 0.0])
    np.testing.assert_allclose(np.diag(after.covariance)[known], [0.04, 9.0])
    rest = np.array([0, 2])
    assert not after.covariance[np.ix_(known, rest)].any()
    np.testing.assert_array_equal(after.covariance[np.ix_(rest, rest)], covariance[np.ix_(rest, rest)])
    moved = after.mean.copy()
    moved[known] += 10.0  # seen where it leapt to, which tells nothing of where it was
    seen = Belief(
        moved, 0.5 * after.covariance, after.predicted, after.predicted_covariance, after.transition, led.doubt
    )
    back = smoothed([first, seen])[0]
    np.testing.assert_allclose(back.mean, first.mean, atol=1e-9)
