"""The full skeleton of small clips: its joints, its angles and its limbs."""

import full_skeleton_clips as clips
import numpy as np
import pytest
from full_skeleton_clips import BANDAI_LIKE, clip, wandering
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import OVERHANG, attach, person_surface, residuals
from workbench.datasets.rendering.visible import surface_points
from workbench.motion.full_skeleton import full_body, full_poses, full_skeleton
from workbench.utils.errors import InputError

ENDS = tuple(name for name in clips.BANDAI_LIKE if name.endswith("_end"))


def bandai_like(seed, **options):
    """Return a clip like Bandai's: the root is fixed, the hips translate within it, end sites do not turn."""
    rotations = clips.wandering(clips.BANDAI_LIKE, seed, still=("joint_Root", *ENDS), **options)
    offsets = np.array([offset for _, offset in clips.BANDAI_LIKE.values()])
    positions = np.broadcast_to(offsets, (len(rotations), *offsets.shape)).copy()
    positions[:, 1] = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.03, (len(rotations), 3)), axis=0)
    return clips.clip(clips.BANDAI_LIKE, rotations, positions)


def positions_of(clip, names):
    return clip.positions[:, [clip.joint(name) for name in names]]


@pytest.mark.parametrize("seed", range(2))
def test_forward_kinematics_gives_the_clips_positions(seed):
    clip = bandai_like(seed)
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    assert poses.shape == (60, 66)
    np.testing.assert_allclose(joints(skeleton, poses), positions_of(clip, skeleton.names), atol=1e-12)


def test_the_neutral_pose_stands_upright():
    skeleton = full_skeleton(bandai_like(0))
    frames = forward(skeleton, np.zeros((1, 66)))
    position = dict(zip(skeleton.names, frames.positions[0], strict=True))
    np.testing.assert_allclose(position["Head"], [0, 0, 0.52], atol=1e-12)
    np.testing.assert_allclose(position["UpperArm_L"], [0, 0.11, 0.4], atol=1e-12)  # the person's left is y
    np.testing.assert_allclose(position["Hand_R"], [0, -0.11, 0.4 - 0.48], atol=1e-12)  # arms hang
    np.testing.assert_allclose(position["UpperLeg_L"], [0, 0.07, -0.02], atol=1e-12)
    np.testing.assert_allclose(position["Foot_R"], [0, -0.07, -0.83], atol=1e-12)
    np.testing.assert_allclose(position["Toes_R"], [0.12, -0.07, -0.83], atol=1e-12)  # toes point forward


def test_a_positive_turn_about_y_flexes_the_knee():
    skeleton = full_skeleton(bandai_like(0))
    pose = np.zeros((1, 66))
    pose[0, skeleton.dof("LowerLeg_L_y")] = 0.5
    ankle = joints(skeleton, pose)[0, skeleton.joint("Foot_L")]
    np.testing.assert_allclose(ankle, [-0.41 * np.sin(0.5), 0.07, -0.42 - 0.41 * np.cos(0.5)], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_angles_change_no_faster_than_the_joints_turn(seed):
    """A turn by w changes no angle by more than w / cos(middle angle), so there are no jumps."""
    clip = bandai_like(seed, size=0.005, n=200)
    skeleton, poses = full_skeleton(clip), full_poses(clip)
    checked = 0
    for joint, name in enumerate(skeleton.names):
        rotations = Rotation.from_matrix(clip.rotations[:, clip.joint(name)])
        turned = (rotations[:-1].inv() * rotations[1:]).magnitude()
        angles = poses[:, skeleton.dof_joints == joint][:, -3:]
        cosines = np.minimum(*np.abs(np.cos([angles[:-1, 1], angles[1:, 1]])))
        changes, regular = np.abs(np.diff(angles, axis=0)).max(axis=1), cosines > 0.2
        checked += regular.sum()
        # a quarter more, because the middle angle changes during the turn
        assert np.all(changes[regular] < 1.25 * turned[regular] / cosines[regular])
    assert checked > 0.7 * 21 * 199


def test_full_turns_accumulate():
    turning = np.broadcast_to(np.eye(3), (90, len(clips.TRAVELLER), 3, 3)).copy()
    turning[:, 0] = Rotation.from_rotvec(np.linspace(0.0, 6.0 * np.pi, 90)[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    heading = full_poses(clips.clip(clips.TRAVELLER, turning))[:, 3]
    np.testing.assert_allclose(np.diff(heading), 6.0 * np.pi / 89, atol=1e-9)


def test_a_translating_joint_is_rejected():
    rotations = clips.wandering(clips.TRAVELLER, 0)
    offsets = np.array([offset for _, offset in clips.TRAVELLER.values()])
    positions = np.broadcast_to(offsets, (len(rotations), *offsets.shape)).copy()
    positions[5, 2, 0] += 0.0123
    for make in (full_skeleton, full_poses):
        with pytest.raises(
            InputError, match=r"clip made: .* found hand translated by 12\.3 mm within the frame of arm"
        ):
            make(clips.clip(clips.TRAVELLER, rotations, positions))


def test_the_surface_covers_every_bone_and_the_ends():
    body = full_body(bandai_like(0), from_height(1.7))
    ends = {f"{name}_end" for name in ("Head", "Hand_L", "Hand_R", "Toes_L", "Toes_R")}
    assert set(person_surface(body).part_names) == {*body.skeleton.names[1:], *ends}
    traveller = full_body(clips.clip(clips.TRAVELLER, clips.wandering(clips.TRAVELLER, 0)), from_height(1.7))
    assert person_surface(traveller).part_names == ("arm", "hand", "hand_end", "tail")


SHAPE = from_height(1.7)
BODY = full_body(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)), SHAPE)


def test_a_limbs_axes_are_orthonormal_with_z_along_it():
    for limbs in (BODY.limbs, person(SHAPE).limbs):
        np.testing.assert_allclose(limbs.axes.swapaxes(1, 2) @ limbs.axes, np.tile(np.eye(3), (len(limbs), 1, 1)),
                                   atol=1e-12)  # fmt: skip
        assert np.linalg.det(limbs.axes) == pytest.approx(1.0)
        along = np.einsum("l,la->la", limbs.lengths, limbs.axes[:, :, 2])
        np.testing.assert_allclose(along, limbs.ends - limbs.starts, atol=1e-12)
    toes = BODY.limbs.axes[BODY.limbs.names.index("Toes_L")]  # this bone points forward in the neutral pose
    np.testing.assert_allclose(toes.T, [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(2))
def test_points_of_the_limbs_lie_on_the_skin(seed):
    rng = np.random.default_rng(seed)
    pose = 0.3 * rng.standard_normal(len(BODY.skeleton.dof_names))
    surface, frames = person_surface(BODY), forward(BODY.skeleton, pose[None])
    points = surface_points(BODY, pose, 4000, rng)
    distances = residuals(BODY.skeleton, surface, pose, points, "distance", attach(surface, frames, points))
    assert np.median(np.abs(distances)) < 0.01  # as for the person, along a limb
    # a limb's rounded end is as long as its smaller radius; the skin covers the overhang of it
    assert distances.max() < (1.0 - OVERHANG) * BODY.limbs.radii.min(axis=2).max()
