"""Neck and feet: their sizes and positions, and the bodies that can have them."""

import numpy as np
import pytest

from workbench.body.kinematics import forward
from workbench.body.limbs import FOOT_BREADTH, person, with_neck_and_feet
from workbench.body.shape import ANKLE_HEIGHT, FOOT_LENGTH, from_height
from workbench.utils.errors import InputError

TALL = 1.7
PLAIN = person(from_height(TALL))
BODY = with_neck_and_feet(PLAIN)


def limb(name):
    """Return both ends (2, 3) of a limb in the world, of a body that stands at the origin, and its radii (2, 2)."""
    k = BODY.limbs.names.index(name)
    frames = forward(BODY.skeleton, np.zeros((1, 25)))
    turn, origin = frames.rotations[0, BODY.limbs.joints[k]], frames.positions[0, BODY.limbs.joints[k]]
    return np.stack([BODY.limbs.starts[k], BODY.limbs.ends[k]]) @ turn.T + origin, BODY.limbs.radii[k]


def test_the_plain_bodys_limbs_come_first_and_are_unchanged():
    assert BODY.limbs.names == (*PLAIN.limbs.names, "neck", "left_foot", "right_foot")
    assert np.array_equal(BODY.limbs.radii[: len(PLAIN.limbs)], PLAIN.limbs.radii)
    assert BODY.skeleton is PLAIN.skeleton
    assert not BODY.limbs.spheres[-3:].any()


@pytest.mark.parametrize("side", ["left", "right"])
def test_feet_are_below_the_ankles_and_point_forward(side):
    ends, radii = limb(f"{side}_foot")
    frames = forward(BODY.skeleton, np.zeros((1, 25)))
    ankle = frames.positions[0, BODY.skeleton.joint(f"{side}_ankle")]
    assert ends[:, 2] - radii[:, 0] == pytest.approx(np.full(2, ankle[2] - ANKLE_HEIGHT * TALL), abs=1e-3)  # soles
    assert ends[1, 0] - ends[0, 0] == pytest.approx(FOOT_LENGTH * TALL, rel=1e-3)
    assert ends[0, 0] < ankle[0] < ends[1, 0]
    assert ends[:, 1] == pytest.approx(np.full(2, ankle[1]))
    assert 2.0 * radii[1, 1] == pytest.approx(FOOT_BREADTH * TALL, rel=1e-3)


def test_the_neck_joins_head_and_torso():
    ends, _ = limb("neck")
    torso, _ = limb("torso")
    head, (radius, _) = limb("head")
    assert ends[0, 2] == pytest.approx(torso[1, 2], abs=0.01)
    assert head[0, 2] - radius[0] < ends[1, 2] < head[0, 2]


def test_neck_and_feet_scale_with_the_body():
    scaled, expected = BODY.scaled(2.0).limbs, with_neck_and_feet(PLAIN.scaled(2.0)).limbs
    for name in ("starts", "ends", "radii"):
        np.testing.assert_allclose(getattr(scaled, name), getattr(expected, name))


def test_a_body_with_neck_and_feet_is_rejected():
    with pytest.raises(InputError, match="a person's plain body alone"):
        with_neck_and_feet(BODY)
