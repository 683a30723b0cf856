"""Stubs of frame likelihoods for the tests of the extended Kalman filter."""

import numpy as np

from workbench.body.skeleton import JOINT_NAMES


class StubFrameLikelihood:
    """A likelihood that is its own frame likelihood; methods that a test must not call raise."""

    n_levels, informative, notes, diagnostics = 2, True, (), {}

    def prepare(self, previous, frame):
        return self

    def update(self, expected_pose):
        return self

    def mean_loss(self, pose):
        return np.zeros(len(JOINT_NAMES))

    def evaluate(self, previous_pose, pose):
        raise AssertionError

    derivatives = evaluate
