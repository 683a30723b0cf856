"""Forward kinematics against SciPy's rotations and closed forms; its Jacobian by differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward, joint_jacobian, joints, undetermined, world_axes
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton

SHAPE = from_height(1.75)
SKELETON = person_skeleton(SHAPE)


def poses(seed, n):
    """Return n random poses within the limits, with any root."""
    rng = np.random.default_rng(seed)
    low, high = SKELETON.limits[3:, 0].copy(), SKELETON.limits[3:, 1].copy()
    low[:3], high[:3] = -np.pi, np.pi
    return np.concatenate([rng.normal(0.0, 3.0, (n, 3)), rng.uniform(low, high, (n, 22))], axis=1)


def relative_positions(**angles):
    """Return the positions of all joints relative to the pelvis, by name, for a pose with the given angles."""
    pose = np.zeros((1, 25))
    for name, angle in angles.items():
        pose[0, SKELETON.dof(name)] = angle
    places = dict(zip(JOINT_NAMES, joints(SKELETON, pose)[0], strict=True))
    return {name: place - places["pelvis"] for name, place in places.items()}


def by_scipy(pose):
    """Return positions and rotations of all joints by SciPy's Euler angles ("XYZ": intrinsic, outermost first)."""
    p = dict(zip(POSE_NAMES, pose, strict=True))
    rotations = {"pelvis": Rotation.from_euler("ZYX", [p["root_heading"], p["root_pitch"], p["root_roll"]])}
    places = {"pelvis": pose[:3]}

    def attach(joint, parent, offset, order, angles):
        places[joint] = places[parent] + rotations[parent].apply(offset)
        rotations[joint] = rotations[parent] * Rotation.from_euler(order, angles) if order else rotations[parent]

    attach("neck", "pelvis", SHAPE.neck, "ZYX", [p["neck_turn"], p["neck_nod"], p["neck_tilt"]])
    attach("head_centre", "neck", SHAPE.head, "", [])
    for side, s in (("left", 1.0), ("right", -1.0)):
        mirror = np.array([1.0, s, 1.0])
        abduction, flexion, twist = (p[f"{side}_shoulder_{turn}"] for turn in ("abduction", "flexion", "twist"))
        attach(f"{side}_shoulder", "pelvis", mirror * SHAPE.shoulder, "XYZ", [s * abduction, -flexion, -s * twist])
        attach(f"{side}_elbow", f"{side}_shoulder", [0, 0, -SHAPE.upper_arm], "Y", [-p[f"{side}_elbow_flexion"]])
        attach(f"{side}_wrist", f"{side}_elbow", [0, 0, -SHAPE.forearm], "", [])
        flexion, abduction, twist = (p[f"{side}_hip_{turn}"] for turn in ("flexion", "abduction", "twist"))
        attach(f"{side}_hip", "pelvis", mirror * SHAPE.hip, "YXZ", [-flexion, s * abduction, -s * twist])
        attach(f"{side}_knee", f"{side}_hip", [0, 0, -SHAPE.thigh], "Y", [p[f"{side}_knee_flexion"]])
        attach(f"{side}_ankle", f"{side}_knee", [0, 0, -SHAPE.calf], "", [])
    return np.stack([places[n] for n in JOINT_NAMES]), np.stack([rotations[n].as_matrix() for n in JOINT_NAMES])


def test_kinematics_agree_with_scipys_rotations():
    batch = poses(1, 100)
    frames = forward(SKELETON, batch)
    for pose, positions, rotations in zip(batch, frames.positions, frames.rotations, strict=True):
        expected_positions, expected_rotations = by_scipy(pose)
        np.testing.assert_allclose(positions, expected_positions, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(rotations, expected_rotations, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("angle", "joint", "direction"),
    [
        ("hip_flexion", "knee", (1, 0, 0)),  # the thigh forward
        ("hip_abduction", "knee", (0, 1, 0)),  # outward
        ("shoulder_flexion", "elbow", (1, 0, 0)),
        ("shoulder_abduction", "elbow", (0, 1, 0)),
        ("elbow_flexion", "wrist", (1, 0, 0)),  # the forearm forward
        ("knee_flexion", "ankle", (-1, 0, 0)),  # the calf backward
    ],
)
def test_positive_angles_are_anatomical(side, angle, joint, direction):
    """A quarter turn moves a hanging limb from straight down to the given direction, mirrored on the right."""
    towards = np.array(direction) * (1, 1 if side == "left" else -1, 1)
    limb = {"knee": ("hip", SHAPE.thigh), "elbow": ("shoulder", SHAPE.upper_arm),
            "wrist": ("elbow", SHAPE.forearm), "ankle": ("knee", SHAPE.calf)}[joint]  # fmt: skip
    places = relative_positions(**{f"{side}_{angle}": np.pi / 2})
    np.testing.assert_allclose(places[f"{side}_{joint}"] - places[f"{side}_{limb[0]}"], limb[1] * towards, atol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_inward_twist_moves_the_hand_inward_and_the_foot_outward(side):
    """The forearm points forward; the knee is bent."""
    inward = -1.0 if side == "left" else 1.0
    arm = relative_positions(**{f"{side}_elbow_flexion": np.pi / 2, f"{side}_shoulder_twist": 0.5})
    assert np.sign(arm[f"{side}_wrist"][1] - arm[f"{side}_elbow"][1]) == inward
    leg = relative_positions(**{f"{side}_knee_flexion": np.pi / 2, f"{side}_hip_twist": 0.5})
    assert np.sign(leg[f"{side}_ankle"][1] - leg[f"{side}_knee"][1]) == -inward


def test_positive_heading_turns_left_pitch_leans_forward_and_roll_right():
    np.testing.assert_allclose(
        relative_positions(root_heading=np.pi / 2)["left_hip"], [-SHAPE.hip[1], 0, 0], atol=1e-12
    )
    np.testing.assert_allclose(relative_positions(root_pitch=np.pi / 2)["neck"], [SHAPE.neck[2], 0, 0], atol=1e-12)
    np.testing.assert_allclose(relative_positions(root_roll=np.pi / 2)["neck"], [0, -SHAPE.neck[2], 0], atol=1e-12)


def test_jacobian_agrees_with_central_differences():
    """With a step h = 1e-6, truncation h² and rounding 1e-16 |x| / h are about 1e-9 m/rad near the origin."""
    batch = poses(2, 20)
    batch[:, :3] *= 0.1
    jacobian, h = joint_jacobian(SKELETON, batch), 1e-6
    assert jacobian.shape == (20, 15, 3, 25)
    for p in range(25):
        step = h * np.eye(25)[p]
        expected = (joints(SKELETON, batch + step) - joints(SKELETON, batch - step)) / (2 * h)
        np.testing.assert_allclose(jacobian[..., p], expected, rtol=1e-6, atol=1e-8)


def test_world_axes_are_unit_vectors_that_their_own_turns_do_not_move():
    batch = poses(3, 10)
    axes = world_axes(SKELETON, batch, forward(SKELETON, batch))
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1.0, rtol=1e-12)
    for p in range(3, 25):
        turned = batch.copy()
        turned[:, p] += 0.7
        turned_axes = world_axes(SKELETON, turned, forward(SKELETON, turned))
        np.testing.assert_allclose(turned_axes[:, p], axes[:, p], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("shape", [(25,), (3, 24), (2, 3, 25)])
def test_poses_of_the_wrong_shape_are_rejected(shape):
    for function in (forward, joint_jacobian):
        with pytest.raises(ValueError, match=r"poses must be \(N, 25\)"):
            function(SKELETON, np.zeros(shape))


ARM = {"left_shoulder_abduction", "left_shoulder_flexion", "left_shoulder_twist"}


@pytest.mark.parametrize(
    ("hidden", "free", "parameters"),
    [
        ((), (), ()),
        (("neck", "pelvis"), (), ()),  # fixed to the trunk
        (("left_wrist",), ("left_wrist",), {"left_shoulder_twist", "left_elbow_flexion"}),
        (("left_elbow",), ("left_elbow",), ARM),  # it turns about the line from the shoulder to the wrist
        (("left_elbow", "left_wrist"), ("left_elbow", "left_wrist"), ARM | {"left_elbow_flexion"}),
        (("head_centre", "neck"), ("head_centre",), {"neck_turn", "neck_nod", "neck_tilt"}),
        (JOINT_NAMES, JOINT_NAMES, set(POSE_NAMES)),
    ],
)
def test_undetermined_joints_and_parameters(hidden, free, parameters):
    free_joints, free_parameters = undetermined(SKELETON, ~np.isin(JOINT_NAMES, hidden))
    assert set(np.array(JOINT_NAMES)[free_joints]) == set(free)
    assert set(np.array(POSE_NAMES)[free_parameters]) == set(parameters)
