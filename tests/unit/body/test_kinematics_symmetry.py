"""Properties of kinematics and of the plain camera under mirroring, turning and shifting."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.angles import mirror_image
from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.cameras.camera import plain_camera

SKELETON = person_skeleton(from_height(1.75))
FEW_EXAMPLES = settings(max_examples=30)
POSES = st.lists(st.floats(-3.0, 3.0), min_size=25, max_size=25).map(lambda x: np.array([x]))


def other_side(name):
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(side):
            return other + name.removeprefix(side)
    return name


@FEW_EXAMPLES
@given(POSES)
def test_a_mirrored_pose_has_mirrored_joints(pose):
    swapped = [JOINT_NAMES.index(other_side(name)) for name in JOINT_NAMES]
    expected = joints(SKELETON, pose)[:, swapped] * [1.0, -1.0, 1.0]
    np.testing.assert_allclose(joints(SKELETON, mirror_image(pose)), expected, rtol=0.0, atol=1e-12)


@FEW_EXAMPLES
@given(
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    st.tuples(st.floats(0.1, 3.0), st.floats(-1.5, 1.5)),
    st.floats(0.2, 9.0),
    st.floats(-np.pi, np.pi),
)
def test_a_plain_camera_looks_at_its_target(position, steepness, distance, bearing):
    """The target is at the centre of the image and at its distance; z points up."""
    flat, slope = steepness[0], steepness[1]
    direction = np.array([flat * np.cos(bearing), flat * np.sin(bearing), slope])
    direction *= distance / np.linalg.norm(direction)
    target = np.add(position, direction)
    camera = plain_camera(320, 240, 300.0, position, tuple(target))
    np.testing.assert_allclose(camera.position, position, atol=1e-9)
    np.testing.assert_allclose(camera.to_camera(target), [0.0, 0.0, distance], atol=1e-9)
    np.testing.assert_allclose(camera.project(target), [159.5, 119.5], atol=1e-6)
    up = camera.rotation @ [0.0, 0.0, 1.0]
    assert abs(up[0]) < 1e-9
    assert up[1] < 0.0
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(camera.rotation) > 0.0
