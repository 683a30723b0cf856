"""Neck and feet, which the body of paper A lacks: people have them, and images show them."""

from dataclasses import replace

import numpy as np

from workbench.body.limbs import Body
from workbench.body.shape import ANKLE_HEIGHT, LEG_LENGTH
from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.errors import InputError

FOOT_LENGTH, FOOT_BREADTH = 0.152, 0.055
"""Of a foot, in its owner's heights (Drillis & Contini 1966, in Winter, *Biomechanics and Motor Control of Human
Movement*, 4th ed. 2009, fig. 4.1)."""
_HEEL_BEHIND, _HEEL_BREADTH, _TOES_HEIGHT = 0.035, 0.0396, 0.022
"""Of a foot, likewise, but ours: how far the heel is behind the ankle, how broad it is, how high the toes are."""
_NECK_BELOW, _NECK_RADII = 0.015, ((0.036, 0.036), (0.034, 0.032))
"""Of a neck, in heights, ours: how far below its joint it begins, and its radii there and at the head."""
_CHIN = 0.65
"""How far below the head's centre the neck ends, in the head's radii."""


def with_neck_and_feet(body: Body) -> Body:
    """Return a person's body with a neck and two feet behind its limbs: the neck hangs on its joint, the feet on the
    knees, stiff, at right angles to the calves. Raises InputError for another skeleton than a person's, and for a body
    that has them."""
    if body.skeleton.names != JOINT_NAMES or "neck" in body.limbs.names:
        raise InputError("body: neck and feet are added to a person's plain body alone")
    shape, limbs = body.shape, body.limbs
    tall = (shape.thigh + shape.calf) / LEG_LENGTH
    up, ankle = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -shape.calf])
    heel = ankle + tall * np.array([-_HEEL_BEHIND, 0.0, -0.5 * ANKLE_HEIGHT])
    toes = ankle + tall * np.array([FOOT_LENGTH - _HEEL_BEHIND, 0.0, 0.5 * _TOES_HEIGHT - ANKLE_HEIGHT])
    foot = 0.5 * tall * np.array([[ANKLE_HEIGHT, _HEEL_BREADTH], [_TOES_HEIGHT, FOOT_BREADTH]])
    nape, chin = -tall * _NECK_BELOW * up, np.array(shape.head) - _CHIN * shape.head_radius * up
    rows = [
        ("neck", "neck", nape, chin, tall * np.array(_NECK_RADII)),
        ("left_foot", "left_knee", heel, toes, foot),
        ("right_foot", "right_knee", heel, toes, foot),
    ]
    return replace(body, limbs=limbs.extended(rows))
