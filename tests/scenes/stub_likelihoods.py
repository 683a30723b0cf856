"""Looks at made-up images, for the tests of the Kalman filter: what a test does not need of them."""

import numpy as np

from workbench.body.skeleton import JOINT_NAMES


class MadeUpLook:
    """A likelihood and its look at once, the same in every frame; what is not asked in a test raises."""

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
