"""The skeleton with feet: its first part is the person's, and its ankles move heel and toes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.angles import swap_left_right
from workbench.body.kinematics import forward, joint_jacobian, joints
from workbench.body.limbs import person, person_on, person_with_feet
from workbench.body.shape import ANKLE_HEIGHT, FOOT_LENGTH, from_height
from workbench.body.skeleton import (
    FOOT_POINTS,
    JOINT_NAMES,
    JOINT_NAMES_WITH_FEET,
    POSE_NAMES,
    POSE_NAMES_WITH_FEET,
    feet_skeleton,
    person_skeleton,
)
from workbench.utils.errors import InputError

TALL = 1.7
PLAIN, FEET = person_skeleton(from_height(TALL)), feet_skeleton(from_height(TALL))
POSES = st.lists(st.floats(-3.0, 3.0), min_size=27, max_size=27).map(lambda x: np.array([x]))
FEW_EXAMPLES = settings(max_examples=30)


def test_the_person_is_the_first_part():
    assert FEET.names == JOINT_NAMES_WITH_FEET
    assert FEET.names[:15] == JOINT_NAMES
    assert FEET.names[15:] == ("left_foot", "left_heel", "left_toes", "right_foot", "right_heel", "right_toes")
    assert FEET.dof_names == POSE_NAMES_WITH_FEET == (*POSE_NAMES, "left_ankle_flexion", "right_ankle_flexion")
    assert FOOT_POINTS == ("left_heel", "left_toes", "right_heel", "right_toes")
    assert (np.diff(FEET.dof_joints) >= 0).all()
    for name in ("parents", "offsets"):
        assert np.array_equal(getattr(FEET, name)[:15], getattr(PLAIN, name))
    for name in ("dof_joints", "dof_axes", "limits"):
        assert np.array_equal(getattr(FEET, name)[:25], getattr(PLAIN, name))


@FEW_EXAMPLES
@given(POSES)
def test_the_persons_joints_are_bitwise_those_without_feet(pose):
    expected, found = forward(PLAIN, pose[:, :25]), forward(FEET, pose)
    assert np.array_equal(found.positions[:, :15], expected.positions)
    assert np.array_equal(found.rotations[:, :15], expected.rotations)


def test_exchanged_sides_exchange_the_ankles():
    pose = np.arange(27.0)
    assert np.array_equal(swap_left_right(pose)[:25], swap_left_right(pose[:25]))
    assert swap_left_right(pose)[25:].tolist() == [26.0, 25.0]


@pytest.mark.parametrize("side", ["left", "right"])
def test_dorsiflexion_lifts_the_toes_by_the_angle(side):
    """A foot at right angles to a vertical calf stands flat, and turns about the ankle by its flexion."""
    pose, angle = np.zeros((1, 27)), 0.3
    heel, toes = (FEET.joint(f"{side}_{end}") for end in ("heel", "toes"))
    flat = joints(FEET, pose)[0]
    ankle = flat[FEET.joint(f"{side}_ankle")]
    assert flat[toes, 0] - flat[heel, 0] == pytest.approx(FOOT_LENGTH * TALL, rel=1e-3)
    assert (flat[[heel, toes], 2] < ankle[2]).all()
    assert flat[heel, 2] == pytest.approx(ankle[2] - ANKLE_HEIGHT * TALL)  # at the sole
    assert flat[heel, 2] < flat[toes, 2] < ankle[2] - 0.5 * ANKLE_HEIGHT * TALL
    assert flat[[heel, toes], 1] == pytest.approx(np.full(2, ankle[1]))
    pose[0, FEET.dof(f"{side}_ankle_flexion")] = angle
    lifted = joints(FEET, pose)[0]
    offsets, turned = flat[[heel, toes]] - ankle, lifted[[heel, toes]] - ankle
    rise = np.arctan2(turned[:, 2], turned[:, 0]) - np.arctan2(offsets[:, 2], offsets[:, 0])
    np.testing.assert_allclose((rise + np.pi) % (2.0 * np.pi) - np.pi, angle)
    assert np.array_equal(np.delete(lifted, [heel, toes], axis=0), np.delete(flat, [heel, toes], axis=0))


def test_the_limbs_are_the_persons_with_neck_and_feet_on_their_joints():
    body, plain = person_with_feet(from_height(TALL)), person(from_height(TALL))
    assert body.limbs.names == (*plain.limbs.names, "neck", "left_foot", "right_foot")
    assert [body.skeleton.names[j] for j in body.limbs.joints[-2:]] == ["left_foot", "right_foot"]
    heel, toes = (body.skeleton.offsets[body.skeleton.joint(f"left_{name}")] for name in ("heel", "toes"))
    np.testing.assert_array_equal(body.limbs.ends[-2], toes)
    np.testing.assert_allclose(body.limbs.starts[-2] - heel, [0.0, 0.0, 0.5 * ANKLE_HEIGHT * TALL], rtol=1e-3)
    scaled = body.scaled(2.0)
    np.testing.assert_allclose(scaled.skeleton.offsets, feet_skeleton(from_height(TALL).scaled(2.0)).offsets)


def test_an_unknown_skeleton_is_rejected():
    assert len(person_on("person", from_height(TALL)).skeleton.names) == 15
    assert len(person_on("feet", from_height(TALL)).skeleton.names) == 21
    with pytest.raises(InputError, match="skeleton must be one of person, feet, found 'foot'"):
        person_on("foot", from_height(TALL))


def test_the_jacobian_agrees_with_finite_differences():
    pose = np.random.default_rng(0).uniform(-1.0, 1.0, (1, 27))
    steps = 1e-6 * np.eye(27)
    expected = np.stack([(joints(FEET, pose + step) - joints(FEET, pose - step))[0] / 2e-6 for step in steps], axis=-1)
    np.testing.assert_allclose(joint_jacobian(FEET, pose)[0], expected, atol=1e-8)
