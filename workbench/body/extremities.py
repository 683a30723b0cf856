"""Neck and feet, which the body of paper A lacks: people have them, and images show them."""

from dataclasses import replace

import numpy as np

from workbench.body.limbs import Body, Limbs
from workbench.body.shape import ANKLE_HEIGHT, LEG_LENGTH
from workbench.body.skeleton import JOINT_NAMES
from workbench.errors import InputError

FOOT_LENGTH, FOOT_BREADTH = 0.152, 0.055
"""Of a foot, in its owner's heights (Drillis & Contini 1966, in Winter, *Biomechanics and Motor Control of Human
Movement*, 4th ed. 2009, fig. 4.1)."""
_HEEL = 0.035  # how far the heel is behind the ankle
_TOES = 0.011  # half the height of the toes
_NECK_BELOW, _NECK_RADII = 0.015, ((0.036, 0.036), (0.034, 0.032))  # below its joint; there and at the head: ours


def with_neck_and_feet(body: Body) -> Body:
    """Return a person's body with a neck and two feet behind its limbs: the neck hangs on its joint, the feet on the
    knees, at right angles to the calves. Raises InputError for another skeleton than a person's, and a body that has
    them."""
    if body.skeleton.names != JOINT_NAMES or "neck" in body.limbs.names:
        raise InputError("body: neck and feet are added to a person's plain body alone")
    shape, limbs = body.shape, body.limbs
    tall = (shape.thigh + shape.calf) / LEG_LENGTH
    up, ankle = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -shape.calf])
    heel = ankle + tall * np.array([-_HEEL, 0.0, -0.5 * ANKLE_HEIGHT])
    toes = ankle + tall * np.array([FOOT_LENGTH - _HEEL, 0.0, _TOES - ANKLE_HEIGHT])
    foot = tall * np.array([[0.5 * ANKLE_HEIGHT, 0.36 * FOOT_BREADTH], [_TOES, 0.5 * FOOT_BREADTH]])
    nape, chin = -tall * _NECK_BELOW * up, np.array(shape.head) - 0.65 * shape.head_radius * up
    rows = [
        ("neck", "neck", nape, chin, tall * np.array(_NECK_RADII)),
        ("left_foot", "left_knee", heel, toes, foot),
        ("right_foot", "right_knee", heel, toes, foot),
    ]
    names, joints, starts, ends, radii = zip(*rows, strict=True)
    added = Limbs(
        names=(*limbs.names, *names),
        joints=np.append(limbs.joints, [JOINT_NAMES.index(joint) for joint in joints]),
        starts=np.concatenate([limbs.starts, starts]),
        ends=np.concatenate([limbs.ends, ends]),
        radii=np.concatenate([limbs.radii, radii]),
        spheres=np.append(limbs.spheres, np.zeros(len(rows), dtype=np.bool_)),
    )
    return replace(body, limbs=added)
