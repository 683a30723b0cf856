"""A skeleton with every joint of a motion file (paper D: 28 joints, about 80 degrees of freedom), and its poses.

The joint frames of a file have arbitrary orientations. Here, as in every skeleton of the workbench, they are parallel
to the root's in the neutral pose. That is the file's rest pose or, if the rest pose is not that of a person (Bandai's
bones all lie along one line), upright with hanging arms. Only the angles change, not the joint positions.
"""

from typing import Any

import numpy as np
import scipy

from workbench.body.limbs import Body, Ends, Radii, skeleton_limbs
from workbench.body.shape import Shape
from workbench.body.skeleton import N_ROOT, POSE_NAMES, Skeleton
from workbench.motion.clip import MotionClip
from workbench.motion.retarget import continuous_angles
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_RIGID_M = 1e-5  # files round offsets to micrometres
_SHORT_M = 1e-6
_ROTATED = 1e-9

# Directions of the x and y axes of Bandai's frames in the neutral pose. Bones lie along y, backwards on the right.
_DIRECTIONS = {
    "forward": (1.0, 0.0, 0.0), "backward": (-1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0), "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0),
}  # fmt: skip
_BANDAI = {
    "Hips": ("forward", "up"), "Shoulder_L": ("forward", "left"), "Shoulder_R": ("backward", "left"),
    **dict.fromkeys(("Spine", "Chest", "Neck", "Head"), ("left", "up")),
    **dict.fromkeys(("UpperArm_L", "LowerArm_L", "Hand_L", "UpperLeg_L", "LowerLeg_L"), ("forward", "down")),
    **dict.fromkeys(("UpperArm_R", "LowerArm_R", "Hand_R", "UpperLeg_R", "LowerLeg_R"), ("backward", "up")),
    **dict.fromkeys(("Foot_L", "Toes_L"), ("up", "forward")),
    **dict.fromkeys(("Foot_R", "Toes_R"), ("down", "backward")),
}  # fmt: skip
# Half widths and lengths, m, measured on adult silhouettes, by the joint at a bone's distal end.
_LIMB_RADII = {
    "Shoulder": (0.08, 0.06), "UpperArm": (0.06, 0.055), "LowerArm": (0.045, 0.045), "Hand": (0.034, 0.034),
    "UpperLeg": (0.095, 0.085), "LowerLeg": (0.072, 0.072), "Foot": (0.048, 0.048), "Toes": (0.035, 0.042),
}  # fmt: skip
_LIMB_ENDS = {"Hand": (0.13, 0.035, 0.025), "Toes": (0.04, 0.022, 0.04)}
_BANDAI_RADII: Radii = {
    "Spine": (0.105, 0.15), "Chest": (0.10, 0.14), "Neck": (0.10, 0.15), "Head": (0.055, 0.055),
    **{f"{name}_{side}": size for name, size in _LIMB_RADII.items() for side in "LR"},
}  # fmt: skip
_BANDAI_ENDS: Ends = {
    "Head": (0.11, 0.09, 0.075), **{f"{name}_{side}": size for name, size in _LIMB_ENDS.items() for side in "LR"},
}  # fmt: skip


def full_skeleton(clip: MotionClip) -> Skeleton:
    """Return the skeleton of a clip: six degrees of freedom of the root, three rotations of every other moving joint.

    The root is the first joint that carries the body: a root whose only child translates in its frame is excluded, as
    are end sites without a length. Names are the file's. The root's degrees of freedom have the names and axes of the
    person's; the others are "<joint>_x", "_y", "_z", rad, about the body's axes in the neutral pose. The rotation about
    the bone is last and, except for lateral bones, the one about y, the flexion, is first: angles are singular where
    the middle one reaches 90° (arms straight out to the side). A joint whose frame never rotates in this clip is rigid.
    A Bandai clip has 21 joints and 66 degrees of freedom; a few have end sites with lengths, which are additional
    joints. Raises InputError if a joint other than the root translates in its parent's frame.
    """
    included = _included_joints(clip)
    parents = _new_parents(clip, included)
    offsets = np.einsum("jab,jb->ja", _neutral_frames(clip, included)[parents], clip.offsets[included])
    offsets[0] = 0.0
    names = tuple(clip.joints[k] for k in included)
    dofs = [(name, 0, axis) for name, axis in zip(POSE_NAMES, "xyzzyx", strict=False)]
    moving = np.abs(_rotations(clip, included) - np.eye(3)).max(axis=(0, 2, 3)) > _ROTATED
    for joint in np.flatnonzero(moving).tolist():
        if joint > 0:
            dofs += [(f"{names[joint]}_{axis}", joint, axis) for axis in _axis_order(joint, parents, offsets)]
    angle_limits = [(-np.pi, np.pi), (-0.5 * np.pi, 0.5 * np.pi), (-np.pi, np.pi)]
    limits = [(-1e6, 1e6)] * N_ROOT + angle_limits * ((len(dofs) - N_ROOT) // 3)
    return Skeleton(
        names=names, parents=parents, offsets=offsets, dof_names=tuple(name for name, _, _ in dofs),
        dof_joints=np.array([joint for _, joint, _ in dofs]),
        dof_axes=np.array([np.eye(3)["xyz".index(axis)] for _, _, axis in dofs]), limits=np.array(limits),
    )  # fmt: skip


def full_poses(clip: MotionClip) -> FloatArray:
    """Return the poses (F, P) of `full_skeleton(clip)` in the clip's frames, m and rad, without jumps in time.

    Forward kinematics reproduces the clip's positions to the precision of the file's offsets (Bandai: 2e-7 m). Raises
    InputError as `full_skeleton`.
    """
    skeleton, included = full_skeleton(clip), _included_joints(clip)
    rotations = _rotations(clip, included)
    poses = np.zeros((len(clip), len(skeleton.dof_names)))
    poses[:, :3] = clip.positions[:, included[0]]
    for joint in range(len(included)):
        columns = np.flatnonzero(skeleton.dof_joints == joint)[-3:]  # the root's first three are translations
        if len(columns):
            order: Any = "".join("XYZ"[axis] for axis in skeleton.dof_axes[columns].argmax(axis=1))
            angles = scipy.spatial.transform.Rotation.from_matrix(rotations[:, joint]).as_euler(order)
            poses[:, columns] = continuous_angles(angles, skeleton.limits[columns])
    return poses


def full_body(clip: MotionClip, shape: Shape) -> Body:
    """Return the full skeleton of a clip with limbs; shape : the measurements of the same person.

    Bandai's joints have an adult's limb sizes, all others those of `skeleton_limbs`. Raises InputError as
    `full_skeleton`.
    """
    skeleton = full_skeleton(clip)
    radii = {name: size for name, size in _BANDAI_RADII.items() if name in skeleton.names}
    ends = {name: size for name, size in _BANDAI_ENDS.items() if name in skeleton.names}
    return Body(skeleton, shape, skeleton_limbs(skeleton, radii=radii, ends=ends))


def _included_joints(clip: MotionClip) -> IntArray:
    """Return the clip's joints in the skeleton, parents first."""
    joints = np.arange(len(clip.joints))
    translation = np.abs(_translations(clip) - clip.offsets).max(axis=(0, 2))
    root = 0
    while len(children := np.flatnonzero(clip.parents == root)) == 1 and translation[children[0]] > _RIGID_M:
        root = int(children[0])
    included = joints == root
    for k in joints[root + 1 :]:
        included[k] = included[clip.parents[k]]
    for k in np.flatnonzero(included & (translation > _RIGID_M) & (joints != root)):
        raise InputError(
            f"clip {clip.name}: expected joints that only rotate, found {clip.joints[k]} translated by "
            f"{1000.0 * translation[k]:.3g} mm within the frame of {clip.joints[clip.parents[k]]}"
        )
    is_end = ~np.isin(joints, clip.parents) & (joints != root)
    rigid = np.abs(clip.rotations - np.eye(3)).max(axis=(0, 2, 3)) <= _ROTATED
    short = np.linalg.norm(clip.offsets, axis=1) < _SHORT_M
    return np.flatnonzero(included & ~(is_end & rigid & short))


def _translations(clip: MotionClip) -> FloatArray:
    """Return the position (F, K, 3), m, of every joint in its parent's frame; the root's is its offset."""
    translations = np.broadcast_to(clip.offsets, clip.positions.shape).copy()
    for k, parent in enumerate(clip.parents):
        if parent >= 0:
            difference = clip.positions[:, k] - clip.positions[:, parent]
            translations[:, k] = np.einsum("fba,fb->fa", clip.orientations[:, parent], difference)
    return translations


def _new_parents(clip: MotionClip, included: IntArray) -> IntArray:
    """Return the parents (J,) among the included joints, -1 for the first."""
    return np.array([-1, *np.searchsorted(included, clip.parents[included[1:]])])


def _neutral_frames(clip: MotionClip, included: IntArray) -> FloatArray:
    """Return rotations (J, 3, 3) from the file's frames to the body's axes in the neutral pose."""
    neutral = np.broadcast_to(np.eye(3), (len(included), 3, 3)).copy()
    if set(_BANDAI) <= set(clip.joints):
        for row, k in enumerate(included):
            if clip.joints[k] in _BANDAI:
                x, y = (_DIRECTIONS[direction] for direction in _BANDAI[clip.joints[k]])
                neutral[row] = np.stack([x, y, np.cross(x, y)], axis=1)
            else:  # an end site's frame is its joint's
                neutral[row] = neutral[_new_parents(clip, included)[row]]
    return neutral


def _rotations(clip: MotionClip, included: IntArray) -> FloatArray:
    """Return rotations (F, J, 3, 3) to the parents' frames, of the root to the world; identity in the neutral pose."""
    world = clip.orientations[:, included] @ _neutral_frames(clip, included).swapaxes(1, 2)
    rotations: FloatArray = world[:, _new_parents(clip, included)].swapaxes(2, 3) @ world
    rotations[:, 0] = world[:, 0]
    return rotations


def _axis_order(joint: int, parents: IntArray, offsets: FloatArray) -> str:
    """Return the axes of a joint's three rotations, outermost first; the one about the bone is last."""
    children = np.flatnonzero(parents == joint)
    bones = offsets[children] if len(children) else offsets[[joint]]
    along = np.abs(bones.sum(axis=0))
    return {"x": "yzx", "y": "xzy", "z": "yxz"}["xyz"[int(along.argmax())] if along.max() > _ROTATED else "z"]
