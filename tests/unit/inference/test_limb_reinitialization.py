"""Limb reinitialization: accepted only for a displaced limb, and the Gaussian state after it."""

from dataclasses import replace
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
    """A log likelihood with one maximum of `height` nats where the angles of the arm are `mode`."""

    def __init__(self, mode, height, width=0.5):
        self.mode, self.height, self.width, self.compared_joints = mode, height, width, []

    def compare(self, poses, moved):
        self.compared_joints.append(moved)
        return self.height * np.exp(-0.5 * (((poses[:, ARM] - self.mode) / self.width) ** 2).sum(axis=1))


STANDING = np.clip(np.zeros(25), *SKELETON.limits.T)


def displaced_arm(change=0.6):
    low, high = SKELETON.limits[ARM].T
    arm = STANDING[ARM]
    return np.where(high - arm > arm - low, np.minimum(arm + change, high), np.maximum(arm - change, low))


def reinitialized(image, seed=0):
    return reinitialize_limb(image, SKELETON, ARM, STANDING, STANDING, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(5))
def test_a_displaced_arm_is_reinitialized_at_the_mode(seed):
    image = Image(displaced_arm(), 80.0)
    assert isinstance(image, DenseLikelihood)
    pose = reinitialized(image, seed)
    np.testing.assert_allclose(pose[ARM], image.mode, atol=0.3)
    others = np.setdiff1d(np.arange(25), ARM)
    np.testing.assert_array_equal(pose[others], STANDING[others])
    names = [SKELETON.names[k] for k in np.flatnonzero(image.compared_joints[0])]
    assert names == ["left_shoulder", "left_elbow", "left_wrist"]


def test_an_arm_at_the_mode_is_not_reinitialized():
    image = Image(STANDING[ARM], 80.0, width=0.1)
    assert reinitialized(image) is None
    assert len(image.compared_joints) == 1  # no candidate is refined


def test_a_gain_below_the_cost_of_a_reinitialization_is_rejected():
    pose = STANDING.copy()
    pose[ARM] = displaced_arm()
    min_height = MIN_GAIN + reinitialization_cost(pose[ARM], STANDING[ARM])
    assert reinitialized(Image(pose[ARM], 0.9 * min_height)) is None
    for height, expected in ((1.1 * min_height, True), (0.9 * min_height, False)):
        image = Image(pose[ARM], height, width=0.05)
        assert is_better(image, len(SKELETON.names), STANDING, pose, ARM, STANDING) is expected
        assert image.compared_joints[0].all()


def test_a_reinitialized_limb_is_within_the_limits():
    low, high = SKELETON.limits[ARM].T
    outside = np.where(STANDING[ARM] - low < high - STANDING[ARM], low - 0.3, high + 0.3)
    pose = reinitialized(Image(outside, 300.0, width=1.0))
    assert pose is not None
    assert ((pose[ARM] >= low) & (pose[ARM] <= high)).all()


def test_a_decoupled_limb_is_independent_of_the_past():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    first = GaussianState(
        rng.standard_normal(4), root @ root.T, np.zeros(4), np.eye(4), np.eye(4), np.ones(len(POSE_NAMES))
    )
    covariance = first.covariance + np.eye(4)
    predicted = GaussianState(first.mean, covariance, first.mean, covariance, np.eye(4), first.std_inflation)
    limb, rest = np.array([1, 3]), np.array([0, 2])
    decoupled = predicted.decoupled(limb, np.array([5.0, 0.0]), np.array([0.2, 3.0]))
    np.testing.assert_array_equal(decoupled.mean[limb], [5.0, 0.0])
    np.testing.assert_allclose(np.diag(decoupled.covariance)[limb], [0.04, 9.0])
    assert not decoupled.covariance[np.ix_(limb, rest)].any()
    np.testing.assert_array_equal(decoupled.covariance[np.ix_(rest, rest)], covariance[np.ix_(rest, rest)])
    updated_mean = decoupled.mean.copy()
    updated_mean[limb] += 10.0
    updated = replace(decoupled, mean=updated_mean, covariance=0.5 * decoupled.covariance)
    smoothed = smooth_backward([first, updated])[0]
    np.testing.assert_allclose(smoothed.mean, first.mean, atol=1e-9)


class Likelihood(Image):
    """The same image in every frame; records the frames in which a single limb is compared."""

    def __init__(self):
        super().__init__(displaced_arm(), 80.0)
        self.frame, self.limb_frames = None, set()

    def prepare(self, previous, frame):
        self.frame = frame.index
        return self

    def compare(self, poses, moved):
        if not moved.all():
            self.limb_frames.add(self.frame)
        return super().compare(poses, moved)

    def derivatives(self, pose, level, derive=True):
        return Derivatives(0.0, np.zeros(len(pose)), np.eye(len(pose)))


def test_limbs_are_not_reinitialized_in_the_first_frame():
    likelihood, frames = Likelihood(), [Frame(k, k / 30.0, (), None) for k in range(3)]
    body = SimpleNamespace(skeleton=SKELETON)
    filtered = IteratedEkf(Smooth(), likelihood, body, n_particles=2, second_pass=False)
    streams = {name: stream(0, name) for name in ("resampling", "prior")}
    assert len(list(filtered.run(frames, STANDING, streams))) == 3
    assert likelihood.limb_frames == {1, 2}
