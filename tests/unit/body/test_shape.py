"""The shape of an average person and the limbs on the skeleton."""

import numpy as np
import pytest

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.errors import InputError


@pytest.mark.parametrize("height", [0.5, 1.65, 1.75, 2.5])
def test_segments_add_up_to_the_heights_of_the_joints(height):
    """Winter (fig. 4.1): the ankle is at 0.039 H, the knee at 0.285 H, the hip at 0.530 H, the shoulder at 0.818 H."""
    shape, ankle = from_height(height), 0.039 * height
    assert ankle + shape.calf == pytest.approx(0.285 * height)
    assert ankle + shape.calf + shape.thigh == pytest.approx(0.530 * height)
    assert ankle + shape.calf + shape.thigh + shape.shoulder[2] == pytest.approx(0.818 * height)
    top = ankle + shape.calf + shape.thigh + shape.neck[2] + shape.head[2] + shape.head_radius
    assert top == pytest.approx(height, rel=0.02)  # the head is a sphere: its top is the crown to a few centimetres


def test_given_lengths_replace_the_average():
    shape = from_height(1.7, forearm=0.3, hip=(0.0, 0.1, 0.0))
    assert (shape.forearm, shape.hip) == (0.3, (0.0, 0.1, 0.0))
    assert shape.thigh == from_height(1.7).thigh


def test_all_lengths_are_proportional_to_the_height():
    small, scaled, large = (s.as_dict() for s in (from_height(1.0), from_height(1.0).scaled(1.8), from_height(1.8)))
    for name in small:
        np.testing.assert_allclose(scaled[name], 1.8 * np.asarray(small[name]), err_msg=name)
        np.testing.assert_allclose(large[name], scaled[name], err_msg=name)


@pytest.mark.parametrize("height", [175.0, 0.0, -1.7, 0.49, 2.51, float("nan")])
def test_heights_that_are_not_in_metres_are_rejected(height):
    with pytest.raises(InputError, match="height must be given in metres"):
        from_height(height)


def test_unknown_and_nonpositive_lengths_are_rejected():
    with pytest.raises(InputError, match="unknown length 'tail'"):
        from_height(1.7, tail=0.4)
    for name in ("upper_arm", "forearm", "thigh", "calf", "head_radius", "hand_radius"):
        for length in (0.0, -0.1, float("nan")):
            with pytest.raises(InputError, match=f"{name} must be a positive length"):
                from_height(1.7, **{name: length})


def test_the_person_has_the_twelve_limbs_of_paper_a():
    limbs = person(from_height(1.75)).limbs
    assert len(limbs) == 12
    assert limbs.spheres.sum() == 3
    assert {name for name, sphere in zip(limbs.names, limbs.spheres, strict=True) if sphere} == {
        "head", "left_hand", "right_hand",
    }  # fmt: skip
    np.testing.assert_array_equal(limbs.starts[limbs.spheres], limbs.ends[limbs.spheres])
    assert (limbs.radii > 0.0).all()
    # the likelihood's patches assume that a limb lies along its frame's z axis
    np.testing.assert_allclose((limbs.ends - limbs.starts)[:, :2], 0.0, atol=1e-15)


def test_limbs_reach_from_joint_to_joint():
    body = person(from_height(1.75))
    offsets = dict(zip(JOINT_NAMES, body.skeleton.offsets, strict=True))
    limbs = {name: i for i, name in enumerate(body.limbs.names)}
    for side in ("left", "right"):
        for name, joint, child in (
            ("upper_arm", "shoulder", "elbow"), ("forearm", "elbow", "wrist"),
            ("thigh", "hip", "knee"), ("calf", "knee", "ankle"),
        ):  # fmt: skip
            i = limbs[f"{side}_{name}"]
            assert JOINT_NAMES[body.limbs.joints[i]] == f"{side}_{joint}"
            np.testing.assert_array_equal(body.limbs.starts[i], np.zeros(3))
            np.testing.assert_allclose(body.limbs.ends[i], offsets[f"{side}_{child}"])
        hand = limbs[f"{side}_hand"]
        offset = body.limbs.starts[hand] - offsets[f"{side}_wrist"]
        np.testing.assert_allclose(offset, [0.0, 0.0, -1.2 * body.shape.hand_radius])
    np.testing.assert_allclose(body.limbs.starts[limbs["head"]], offsets["head_centre"])
    torso = limbs["torso"]
    np.testing.assert_array_equal(body.limbs.starts[torso], np.zeros(3))
    assert 0.9 * body.shape.neck[2] < body.limbs.ends[torso][2] < body.shape.neck[2]
    np.testing.assert_array_equal(body.limbs.radii[torso], [body.shape.torso_radii_low, body.shape.torso_radii_high])
