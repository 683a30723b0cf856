"""One step with a truth, for the tests of errors."""

import numpy as np

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, Truth, View
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.utils.arrays import FloatArray

BODY = person(from_height(1.8))
SKELETON = BODY.skeleton
CAMERA = plain_camera(640, 480, 700.0, (0.0, -7.0, 1.0), (0.0, 0.0, 1.0))


def step_of(poses: FloatArray, truth: Truth | None, weights: FloatArray | None = None) -> Step:
    n = len(poses)
    weights = np.full(n, 1 / n) if weights is None else weights
    view = View(CAMERA, np.zeros((480, 640), np.uint8))
    return Step(
        frame=Frame(0, 0.0, (view,), truth), space=StateSpace.of({"pose": (tuple(map(str, range(25))), "-")}),
        particles=poses, poses=poses, log_weights=np.log(weights), ancestors=np.arange(n),
        expected_pose=weights @ poses, map_pose=poses[np.argmax(weights)], ess=1 / (weights**2).sum(), log_evidence=0.0,
    )  # fmt: skip


def standing() -> FloatArray:
    pose = np.zeros(25)
    pose[2] = 0.95
    return pose
