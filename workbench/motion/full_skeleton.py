"""A skeleton with every joint of a motion file (paper D: 28 joints, about 80 degrees of freedom), and its poses.

A file's frames point wherever its author liked. Here, as in every skeleton of the workbench, they are parallel to the
root's in the neutral pose, which is the file's rest pose or, where that is nothing like a person (Bandai's bones all
lie along one line), upright with hanging arms. Only the way of counting angles changes: no joint moves by it.
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
_TURNED = 1e-9

# Where the x and y axes of Bandai's frames point in the neutral pose. Their bones lie along y, backwards on the right.
_DIRECTIONS = {
    "ahead": (1.0, 0.0, 0.0), "back": (-1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0), "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0),
}  # fmt: skip
_BANDAI = {
    "Hips": ("ahead", "up"), "Shoulder_L": ("ahead", "left"), "Shoulder_R": ("back", "left"),
    **dict.fromkeys(("Spine", "Chest", "Neck", "Head"), ("left", "up")),
    **dict.fromkeys(("UpperArm_L", "LowerArm_L", "Hand_L", "UpperLeg_L", "LowerLeg_L"), ("ahead", "down")),
    **dict.fromkeys(("UpperArm_R", "LowerArm_R", "Hand_R", "UpperLeg_R", "LowerLeg_R"), ("back", "up")),
    **dict.fromkeys(("Foot_L", "Toes_L"), ("up", "ahead")), **dict.fromkeys(("Foot_R", "Toes_R"), ("down", "back")),
}  # fmt: skip
# Half sizes and lengths, m, read off adult silhouettes, by the joint at a bone's far end.
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
    """The skeleton of a clip: six degrees of freedom of the root, three turns for every other joint that moves.

    The root is the first joint that carries the body: a root whose only child travels in its frame is left out, and so
    are end sites without a length. Names are the file's. The root's degrees of freedom have the names and axes of the
    person's; the others are "<joint>_x", "_y", "_z", rad, about the body's axes in the neutral pose, the turn about
    the bone last and, but for bones to the side, that about y, the flexion, first: angles are singular where the
    middle one reaches 90° (arms straight out to the side). A joint whose frame never turns in this clip is rigid. A
    Bandai clip gives 21 joints and 66 degrees of freedom; a few have end sites with lengths, which are joints more.
    Raises InputError for a clip in which another joint than the root travels in its parent's frame.
    """
    kept = _kept(clip)
    parents = _new_parents(clip, kept)
    offsets = np.einsum("jab,jb->ja", _neutral(clip, kept)[parents], clip.offsets[kept])
    offsets[0] = 0.0
    names = tuple(clip.joints[k] for k in kept)
    dofs = [(name, 0, axis) for name, axis in zip(POSE_NAMES, "xyzzyx", strict=False)]
    turned = np.abs(_turns(clip, kept) - np.eye(3)).max(axis=(0, 2, 3)) > _TURNED
    for joint in np.flatnonzero(turned).tolist():
        if joint > 0:
            dofs += [(f"{names[joint]}_{axis}", joint, axis) for axis in _turn_order(joint, parents, offsets)]
    usual = [(-np.pi, np.pi), (-0.5 * np.pi, 0.5 * np.pi), (-np.pi, np.pi)]
    limits = [(-1e6, 1e6)] * N_ROOT + usual * ((len(dofs) - N_ROOT) // 3)
    return Skeleton(
        names=names, parents=parents, offsets=offsets, dof_names=tuple(name for name, _, _ in dofs),
        dof_joints=np.array([joint for _, joint, _ in dofs]),
        dof_axes=np.array([np.eye(3)["xyz".index(axis)] for _, _, axis in dofs]), limits=np.array(limits),
    )  # fmt: skip


def full_poses(clip: MotionClip) -> FloatArray:
    """The poses (F, P) of `full_skeleton(clip)` in the clip's frames, m and rad, without jumps in time.

    Forward kinematics gives the clip's positions to the digits of the file's offsets (Bandai: 2e-7 m).
    Raises InputError as `full_skeleton` does.
    """
    skeleton, kept = full_skeleton(clip), _kept(clip)
    rotations = _turns(clip, kept)
    poses = np.zeros((len(clip), len(skeleton.dof_names)))
    poses[:, :3] = clip.positions[:, kept[0]]
    for joint in range(len(kept)):
        columns = np.flatnonzero(skeleton.dof_joints == joint)[-3:]  # the root's first three are translations
        if len(columns):
            order: Any = "".join("XYZ"[axis] for axis in skeleton.dof_axes[columns].argmax(axis=1))
            angles = scipy.spatial.transform.Rotation.from_matrix(rotations[:, joint]).as_euler(order)
            poses[:, columns] = continuous_angles(angles, skeleton.limits[columns])
    return poses


def full_body(clip: MotionClip, shape: Shape) -> Body:
    """Put limbs on the full skeleton of a clip; shape: the measurements of the same person. Raises as `full_skeleton`.

    Bandai's joints have an adult's measures, all others those of `skeleton_limbs`.
    """
    skeleton = full_skeleton(clip)
    radii = {name: size for name, size in _BANDAI_RADII.items() if name in skeleton.names}
    ends = {name: size for name, size in _BANDAI_ENDS.items() if name in skeleton.names}
    return Body(skeleton, shape, skeleton_limbs(skeleton, radii=radii, ends=ends))


def _kept(clip: MotionClip) -> IntArray:
    """The clip's joints that the skeleton has, parents first."""
    joints = np.arange(len(clip.joints))
    travelled = np.abs(_places(clip) - clip.offsets).max(axis=(0, 2))
    root = 0
    while len(children := np.flatnonzero(clip.parents == root)) == 1 and travelled[children[0]] > _RIGID_M:
        root = int(children[0])
    below = joints == root
    for k in joints[root + 1 :]:
        below[k] = below[clip.parents[k]]
    for k in np.flatnonzero(below & (travelled > _RIGID_M) & (joints != root)):
        raise InputError(
            f"clip {clip.name}: expected joints that only turn, found {clip.joints[k]} moved by "
            f"{1000.0 * travelled[k]:.3g} mm within the frame of {clip.joints[clip.parents[k]]}"
        )
    is_end = ~np.isin(joints, clip.parents) & (joints != root)
    still = np.abs(clip.rotations - np.eye(3)).max(axis=(0, 2, 3)) <= _TURNED
    short = np.linalg.norm(clip.offsets, axis=1) < _SHORT_M
    return np.flatnonzero(below & ~(is_end & still & short))


def _places(clip: MotionClip) -> FloatArray:
    """Place every joint in its parent's frame, (F, K, 3) m; the root's is its offset."""
    places = np.broadcast_to(clip.offsets, clip.positions.shape).copy()
    for k, parent in enumerate(clip.parents):
        if parent >= 0:
            apart = clip.positions[:, k] - clip.positions[:, parent]
            places[:, k] = np.einsum("fba,fb->fa", clip.orientations[:, parent], apart)
    return places


def _new_parents(clip: MotionClip, kept: IntArray) -> IntArray:
    """Parents (J,) among the kept joints, -1 for the first."""
    return np.array([-1, *np.searchsorted(kept, clip.parents[kept[1:]])])


def _neutral(clip: MotionClip, kept: IntArray) -> FloatArray:
    """Rotations (J, 3, 3) from the file's frames to the body's axes in the neutral pose."""
    neutral = np.broadcast_to(np.eye(3), (len(kept), 3, 3)).copy()
    if set(_BANDAI) <= set(clip.joints):
        for row, k in enumerate(kept):
            if clip.joints[k] in _BANDAI:
                x, y = (_DIRECTIONS[direction] for direction in _BANDAI[clip.joints[k]])
                neutral[row] = np.stack([x, y, np.cross(x, y)], axis=1)
            else:  # an end site's frame is its joint's
                neutral[row] = neutral[_new_parents(clip, kept)[row]]
    return neutral


def _turns(clip: MotionClip, kept: IntArray) -> FloatArray:
    """Rotations (F, J, 3, 3) to the parents' frames, the root's to the world; all are 1 in the neutral pose."""
    world = clip.orientations[:, kept] @ _neutral(clip, kept).swapaxes(1, 2)
    turns: FloatArray = world[:, _new_parents(clip, kept)].swapaxes(2, 3) @ world
    turns[:, 0] = world[:, 0]
    return turns


def _turn_order(joint: int, parents: IntArray, offsets: FloatArray) -> str:
    """The axes of a joint's three turns, outermost first: the turn about the bone last."""
    children = np.flatnonzero(parents == joint)
    bones = offsets[children] if len(children) else offsets[[joint]]
    along = np.abs(bones.sum(axis=0))
    return {"x": "yzx", "y": "xzy", "z": "yxz"}["xyz"[int(along.argmax())] if along.max() > _TURNED else "z"]
