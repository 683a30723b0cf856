"""Retargeting: the 25 pose parameters and the measurements of the person that best fit a clip's joints.

The initial solution is analytic: the torso by a rigid fit, shoulders, hips and neck from the source's rotations, elbows
and knees from the angle between the bones. A few Gauss-Newton steps then reduce the joint errors due to the rigid torso
and the equal lengths of left and right. They are regularised towards the analytic angles, because joint positions do
not determine the twist of a straight limb; the source's hinge axis does.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from workbench.body.angles import wrapped
from workbench.body.kinematics import joint_jacobian, joints
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, Skeleton, joint_of, person_skeleton
from workbench.motion.clip import MotionClip
from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_RESIDUAL_MM

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Landmarks:
    """Locations of the person's joints on the skeletons of one source; vectors in the axes of a MotionClip.

    joints : the source's joint for each of the person's, except the pelvis and the centre of the head. head : (joint,
    child, fraction); the centre of the head is at this fraction of the child's offset, in the joint's frame. head_up :
    direction of the vertex in that joint's frame. lefts : for the neck, the shoulders and the hips, the direction in
    the frame of the source's joint (for the neck: of the head's) that points to the person's left in the neutral pose:
    for a limb the hinge of its elbow or knee, for the neck the line through the ears. head_offset : m, added to the
    centre of the head in the frame of head's joint. bones : for shoulders and hips, the direction of the elbow or knee
    in the frame of the source's joint; empty: along the offset.
    """

    source: str
    joints: Mapping[str, str]
    head: tuple[str, str, float]
    head_up: Vector
    lefts: Mapping[str, Vector]
    head_offset: Vector = (0.0, 0.0, 0.0)
    bones: Mapping[str, Vector] = field(default_factory=dict)


def _both_sides(left: str, right: str, **names: str) -> dict[str, str]:
    """Return e.g. {"left_hip": "lfemur", "right_hip": "rfemur"} from prefixes "l" and "r", and hip="{}femur"."""
    prefixes = {"left": left, "right": right}
    return {
        f"{side}_{joint}": name.format(prefix) for side, prefix in prefixes.items() for joint, name in names.items()
    }


# At rest the thighs of the CMU skeletons are spread by 20 degrees, and the arms by 90 with their hinges turned by 30.
# The neck (C7) is at the end of the bone "lowerneck"; "thorax" ends 5 cm below the shoulders. The wrist is where the
# hand bends, at the end of "wrist"; "radius" stops at two thirds of the way. "head" ends at the vertex.
_COS_20, _SIN_20, _COS_30 = (float(x) for x in (np.cos(np.pi / 9), np.sin(np.pi / 9), np.cos(np.pi / 6)))
CMU = Landmarks(
    source="CMU (ASF/AMC)",
    joints={
        "neck": "upperneck",
        **_both_sides(
            "l", "r", shoulder="{}humerus", elbow="{}radius", wrist="{}hand",
            hip="{}femur", knee="{}tibia", ankle="{}foot",
        ),
    },
    head=("head", "head_end", 0.5),
    head_up=(0.0, 0.0, 1.0),
    lefts={
        "neck": (0.0, 1.0, 0.0), "left_shoulder": (-0.5, 0.0, _COS_30), "right_shoulder": (0.5, 0.0, -_COS_30),
        "left_hip": (0.0, _COS_20, _SIN_20), "right_hip": (0.0, _COS_20, -_SIN_20),
    },
)  # fmt: skip
# Bandai's frames have the bone along x and the hinge along y of the file. "Head" is the base of the skull, 6.5 cm
# above "Neck"; the centre of the head is taken to be 1.5 times as far above "Head".
BANDAI = Landmarks(
    source="Bandai (BVH)",
    joints={
        "neck": "Neck",
        **_both_sides(
            "L", "R", shoulder="UpperArm_{}", elbow="LowerArm_{}", wrist="Hand_{}",
            hip="UpperLeg_{}", knee="LowerLeg_{}", ankle="Foot_{}",
        ),
    },
    head=("Head", "Head", 1.5),
    head_up=(0.0, 1.0, 0.0),
    lefts={
        "neck": (1.0, 0.0, 0.0),
        **dict.fromkeys(("left_shoulder", "right_shoulder", "left_hip", "right_hip"), (0.0, 0.0, 1.0)),
    },
)  # fmt: skip

TORSO_JOINTS = ("neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip")
_MIRRORED = [0, 2, 1, 4, 3]  # the torso's joints with left and right exchanged
_BELOW = {"shoulder": ("elbow", "wrist"), "hip": ("knee", "ankle")}
_REGULARISATION_M_PER_RAD = 0.1
"""A deviation of 1 rad from an analytic angle costs as much as a joint error of 0.1 m. On CMU's walks this reduces the
mean error from 9.9 to 6.9 mm; a tenth of it gains another 0.5 mm, but makes the twist of a straight limb unstable."""


_LEG = from_height(1.0).thigh + from_height(1.0).calf  # of the body height
_STRAIGHT = 0.05
"""Weight of an untwisted limb's hinge: as much as a limb's that is bent by 3°, the precision of joint angles."""
_SAME_AXIS = 0.5  # cosine: hinges along different axes of a frame differ by 90°


def retarget(clip: MotionClip, landmarks: Landmarks | None = None, names: Mapping[str, str] | None = None) -> Motion:
    """Return the motion of a clip.

    The shape has the clip's lengths, averaged over left and right; the radii are those of an average person of the
    height that legs and trunk imply. Angles are continuous in time and may exceed the skeleton's limits.
    `joint_error_mm` is the residual. subject, activity, source, sha256 and licence are empty; the caller sets them.

    Parameters
    ----------
    clip : the clip.
    landmarks : None: those of CMU or Bandai where the clip has their joints and frames, else estimated, see
        `estimated_landmarks`.
    names : the clip's joints by the person's joints, where `joint_names` does not have them.

    Raises
    ------
    InputError : the skeleton lacks joints, or does not have a person's size (a wrong unit).
    """
    landmarks = landmarks or _known_landmarks(clip, names) or estimated_landmarks(clip, names)
    targets = joint_targets(clip, landmarks)
    frames = _ball_frames(clip, landmarks)
    torso = _fit_torso(targets)
    shape = _shape(clip, targets, frames["neck"], torso.joints)
    skeleton = person_skeleton(shape)
    poses = refine(skeleton, _analytic_poses(skeleton, targets, frames, torso), targets)
    errors = np.linalg.norm(joints(skeleton, poses) - targets, axis=-1).mean(axis=0)
    worst = int(np.argmax(np.where(np.isfinite(errors), errors, np.inf)))
    if not 1000.0 * errors[worst] <= MAX_RESIDUAL_MM:
        error = f"{JOINT_NAMES[worst]} {1000.0 * errors[worst]:.3g} mm off, expected at most {MAX_RESIDUAL_MM:g} mm"
        raise InputError(f"clip {clip.name}: retargeting leaves {error}; is it a person's motion?")
    return Motion(
        name=clip.name, subject="", activity="", rate_hz=clip.rate_hz, poses=poses, shape=shape,
        joint_error_mm=1000.0 * errors[[JOINT_NAMES.index(name) for name in ERROR_JOINTS]], source="", sha256="",
        licence="",
    )  # fmt: skip


def joint_targets(clip: MotionClip, landmarks: Landmarks) -> FloatArray:
    """Return the clip's positions of JOINT_NAMES, (F, J, 3) m; the pelvis is the midpoint of the hips.

    Raises InputError if the clip lacks a joint.
    """
    if missing := ", ".join(_missing(clip, landmarks)):
        raise InputError(
            f"clip {clip.name}: expected a skeleton of a supported source; for {landmarks.source} it lacks {missing}"
        )
    positions = {joint: clip.positions[:, clip.joint(source)] for joint, source in landmarks.joints.items()}
    joint, child, fraction = landmarks.head
    offset = fraction * clip.offsets[clip.joint(child)] + np.asarray(landmarks.head_offset)
    positions["head_centre"] = clip.positions[:, clip.joint(joint)] + clip.orientations[:, clip.joint(joint)] @ offset
    positions["pelvis"] = 0.5 * (positions["left_hip"] + positions["right_hip"])
    return np.stack([positions[name] for name in JOINT_NAMES], axis=1)


def _missing(clip: MotionClip, landmarks: Landmarks) -> list[str]:
    return sorted({*landmarks.joints.values(), *landmarks.head[:2]} - set(clip.joints))


def _known_landmarks(clip: MotionClip, names: Mapping[str, str] | None) -> Landmarks | None:
    """Return the landmarks of CMU or Bandai, if the clip has their joints and these bend about the same axes."""
    for landmarks in (CMU, BANDAI):
        if not names and not _missing(clip, landmarks):
            estimated = estimated_landmarks(clip, landmarks.joints).lefts
            cosines = [np.dot(left, estimated[name]) for name, left in landmarks.lefts.items() if name != "neck"]
            if min(cosines) > _SAME_AXIS:
                return landmarks
    return None


def estimated_landmarks(clip: MotionClip, names: Mapping[str, str] | None = None) -> Landmarks:
    """Return the landmarks of any skeleton whose joints have known names, by the clip's motion.

    A hinge is the mean normal of the plane of a limb, in the frame of its upper joint, and for straight limbs the
    direction that points to the left if the limb moved from the neutral pose without a twist. The head is on average
    turned as the torso. Its centre is at the end site of the neck, if that is the head, else 0.06 of the body height
    above the head's joint: half of the distance to the vertex, 0.94 to 1.0 H less the base of the skull at 0.88 H.

    names : the clip's joints by the person's joints, where `joint_names` does not have them. Raises InputError, with
    the person's joints, if the clip lacks joints.
    """
    found = skeleton_joints(clip.joints, clip.parents.tolist(), names, f"clip {clip.name}")
    if missing := [joint for joint in JOINT_NAMES[1:] if joint not in found]:
        raise InputError(
            f"clip {clip.name}: found no joint for {', '.join(missing)}; name them by the key landmarks, "
            f"e.g. {missing[0]}: {clip.joints[-1]}; the skeleton has {', '.join(clip.joints[:12])}"
        )
    at = {joint: clip.positions[:, clip.joint(name)] for joint, name in found.items()}
    across = at["left_hip"] - at["right_hip"] + at["left_shoulder"] - at["right_shoulder"]
    torso = _frame(at["neck"] - 0.5 * (at["left_hip"] + at["right_hip"]), across)
    lefts, bones = {}, {}
    for name in ("left_shoulder", "right_shoulder", "left_hip", "right_hip"):
        side, part = name.split("_")
        middle, lower = (at[f"{side}_{joint}"] for joint in _BELOW[part])
        upper_bone, lower_bone = _unit(middle - at[name]), _unit(lower - middle)
        normal = np.cross(upper_bone, lower_bone) * (1.0 if part == "hip" else -1.0)  # elbows bend the other way
        lefts[name] = _in_frame(clip, found[name], normal + _STRAIGHT * _untwisted_left(torso, upper_bone))
        bones[name] = _in_frame(clip, found[name], upper_bone)
    head, is_end = found["head_centre"], clip.joint(found["head_centre"]) not in clip.parents
    joint = found["neck"] if is_end and clip.joints[clip.parents[clip.joint(head)]] == found["neck"] else head
    lefts["neck"] = _in_frame(clip, joint, torso[..., 1])
    up = _in_frame(clip, joint, _unit(at["head_centre"] - at["neck"]))
    legs = ("left_hip", "left_knee"), ("left_knee", "left_ankle")
    height = sum(float(np.linalg.norm(at[a] - at[b], axis=-1).mean()) for a, b in legs) / _LEG
    raised = 0.06 * height if joint == head else 0.0
    head_offset = up[0] * raised, up[1] * raised, up[2] * raised
    joints_only = {name: found[name] for name in JOINT_NAMES if name not in ("pelvis", "head_centre")}
    return Landmarks("its names", joints_only, (joint, head, float(joint != head)), up, lefts, head_offset, bones)


def _in_frame(clip: MotionClip, joint: str, vectors: FloatArray) -> Vector:
    """Return the mean direction of vectors (F, 3) in the frame of a joint."""
    mean = np.einsum("fba,fb->a", clip.orientations[:, clip.joint(joint)], vectors)
    x, y, z = (mean / max(float(np.linalg.norm(mean)), 1e-12)).tolist()
    return x, y, z


def _untwisted_left(torso: FloatArray, bone: FloatArray) -> FloatArray:
    """Return the torso's left (F, 3) rotated with a limb by the smallest rotation from hanging to the unit vectors
    `bone` (F, 3), times 1 + the cosine of its angle: 0 for a limb that points up, where it is undefined."""
    down, left = -torso[..., 2], torso[..., 1]
    axis, cosine = np.cross(down, bone), np.sum(down * bone, axis=-1, keepdims=True)
    turned = np.cross(axis, left)
    rotated: FloatArray = (1.0 + cosine) * (left + turned) + np.cross(axis, turned)
    return rotated


def _ball_frames(clip: MotionClip, landmarks: Landmarks) -> dict[str, FloatArray]:
    """Return the world rotations (F, 3, 3) of neck, shoulders and hips from the source's rotations."""
    frames = {}
    for name, left in landmarks.lefts.items():
        if name == "neck":
            joint, up = landmarks.head[0], np.asarray(landmarks.head_up)
        else:
            side, part = name.split("_")
            joint, child = landmarks.joints[name], landmarks.joints[f"{side}_{_BELOW[part][0]}"]
            up = -np.asarray(landmarks.bones.get(name, clip.offsets[clip.joint(child)]))
        frames[name] = clip.orientations[:, clip.joint(joint)] @ _frame(up, np.asarray(left))
    return frames


def _frame(up: FloatArray, left: FloatArray) -> FloatArray:
    """Return the rotation (..., 3, 3) with z along `up` and y as close as possible to `left`."""
    z = _unit(up)
    y = _unit(left - np.sum(left * z, axis=-1, keepdims=True) * z)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _unit(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (..., 3); raises InputError if one is shorter than 0.1 mm."""
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if sizes.min() < 1e-4:
        raise InputError("expected a skeleton with bones, hips and shoulders of positive length in every frame")
    return vectors / sizes


@dataclass(frozen=True, eq=False)
class _Torso:
    """The rigid torso: world rotations (F, 3, 3), pelvis positions (F, 3), and TORSO_JOINTS in its frame (5, 3)."""

    rotations: FloatArray
    pelvis: FloatArray
    joints: FloatArray


def _fit_torso(targets: FloatArray) -> _Torso:
    """Fit the rigid, mirror-symmetric torso to its five joints by generalised Procrustes analysis (Gower 1975).

    The initial frame of reference has z from the pelvis to the neck and y along the hips and the shoulders.
    """
    points = targets[:, [JOINT_NAMES.index(name) for name in TORSO_JOINTS]]
    pelvis = joint_of(targets, "pelvis")
    across = points[:, 1] - points[:, 2] + points[:, 3] - points[:, 4]
    rotations = _frame(points[:, 0] - pelvis, across)
    for _ in range(10):  # converges to micrometres in four or five iterations
        model = np.einsum("fba,fjb->ja", rotations, points - pelvis[:, None]) / len(points)
        model = 0.5 * (model + model[_MIRRORED] * [1.0, -1.0, 1.0])
        model = model - 0.5 * (model[3] + model[4])
        rotations, pelvis = _rigid_fit(points, model)
    return _Torso(rotations, pelvis, model)


def _rigid_fit(points: FloatArray, model: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return least-squares R (F, 3, 3), t (F, 3) with points (F, M, 3) ≈ R model (M, 3) + t (Kabsch 1976)."""
    centre, model_centre = points.mean(axis=1), model.mean(axis=0)
    u, _, vt = np.linalg.svd(np.einsum("fja,jb->fab", points - centre[:, None], model - model_centre))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]  # the nearest rotation, not a reflection
    rotations: FloatArray = u @ vt
    return rotations, centre - rotations @ model_centre


def _shape(clip: MotionClip, targets: FloatArray, neck_frames: FloatArray, torso_joints: FloatArray) -> Shape:
    def length(upper: str, lower: str) -> float:
        """Return the mean distance of two joints, over both sides and all frames."""
        ends = [[JOINT_NAMES.index(f"{side}_{end}") for side in ("left", "right")] for end in (upper, lower)]
        return float(np.linalg.norm(targets[:, ends[0]] - targets[:, ends[1]], axis=-1).mean())

    neck, shoulder, hip = torso_joints[0], torso_joints[1], torso_joints[3]
    head = joint_of(targets, "head_centre") - joint_of(targets, "neck")
    head = np.einsum("fba,fb->fa", neck_frames, head).mean(axis=0)
    thigh, calf, average = length("hip", "knee"), length("knee", "ankle"), from_height(1.0)
    average_stack = average.thigh + average.calf + average.neck[2] + average.head[2]
    height = (thigh + calf + neck[2] + head[2]) / average_stack
    if not 0.5 <= height <= 2.5:
        raise InputError(
            f"clip {clip.name}: expected a person of 0.5 to 2.5 m, found one of {height:.3g} m; check the unit"
        )
    return from_height(
        height, neck=(float(neck[0]), 0.0, float(neck[2])), shoulder=tuple(map(float, shoulder)),
        hip=(0.0, float(hip[1]), 0.0), head=(float(head[0]), 0.0, float(head[2])),
        upper_arm=length("shoulder", "elbow"), forearm=length("elbow", "wrist"), thigh=thigh, calf=calf,
    )  # fmt: skip


def _analytic_poses(
    skeleton: Skeleton, targets: FloatArray, frames: Mapping[str, FloatArray], torso: _Torso
) -> FloatArray:
    poses = np.zeros((len(targets), len(skeleton.dof_names)))
    poses[:, :3] = torso.pelvis
    _set_rotations(skeleton, poses, "pelvis", torso.rotations)
    for name, rotations in frames.items():
        _set_rotations(skeleton, poses, name, torso.rotations.swapaxes(1, 2) @ rotations)
        if name == "neck":
            continue
        side, part = name.split("_")
        middle, lower = (JOINT_NAMES.index(f"{side}_{joint}") for joint in _BELOW[part])
        bone = np.einsum("fba,fb->fa", rotations, targets[:, lower] - targets[:, middle])
        flexion = skeleton.dof(f"{JOINT_NAMES[middle]}_flexion")
        # rotating (0, 0, -1) about y by q gives (-sin q, 0, -cos q)
        poses[:, flexion] = skeleton.dof_axes[flexion, 1] * np.arctan2(-bone[:, 0], -bone[:, 2])
    return poses


def _set_rotations(skeleton: Skeleton, poses: FloatArray, joint: str, rotations: FloatArray) -> None:
    """Set the three angles of a joint in the poses from its rotations (F, 3, 3)."""
    dofs = np.flatnonzero(skeleton.dof_joints == skeleton.joint(joint))
    columns: IntArray = dofs[-3:]  # the root's first three are translations
    axes = skeleton.dof_axes[columns]
    order: Any = "".join("XYZ"[int(np.argmax(np.abs(axis)))] for axis in axes)  # scipy's stubs want a literal
    # a rotation by q about -x is one by -q about x
    angles = scipy.spatial.transform.Rotation.from_matrix(rotations).as_euler(order) * axes.sum(axis=1)
    poses[:, columns] = continuous_angles(angles, skeleton.limits[columns])


def continuous_angles(angles: FloatArray, limits: FloatArray) -> FloatArray:
    """Return Euler angles (F, 3) of the same rotations without jumps in time, rad.

    Angles (a, b, c) about different axes and (a + π, π − b, c + π) are the same rotation: each frame uses the one
    nearer to the previous frame. Of the two resulting sequences, the one that exceeds the limits less is returned, or
    if neither does the one with smaller angles, with multiples of 2π subtracted so that the means are nearest the
    limits' middle.

    Parameters
    ----------
    angles : (F, 3), rad.
    limits : (3, 2), the typical range of each angle.
    """
    flipped = np.stack([angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi], axis=1)
    stay = np.sum(wrapped(angles[1:] - angles[:-1]) ** 2, axis=1)
    change = np.sum(wrapped(flipped[1:] - angles[:-1]) ** 2, axis=1)
    on_flipped = np.concatenate([[False], np.cumsum(change < stay) % 2 == 1])
    sequences = []
    for flip in (on_flipped, ~on_flipped):
        sequence = np.unwrap(np.where(flip[:, None], flipped, angles), axis=0)
        sequence -= 2.0 * np.pi * np.round((sequence.mean(axis=0) - limits.mean(axis=1)) / (2.0 * np.pi))
        beyond = np.maximum(0.0, np.maximum(limits[:, 0] - sequence, sequence - limits[:, 1])).sum()
        sequences.append((beyond, np.abs(sequence).sum(), sequence))
    return min(sequences, key=lambda entry: entry[:2])[2]


def refine(skeleton: Skeleton, poses: FloatArray, targets: FloatArray) -> FloatArray:
    """Return poses (F, P) that minimise Σ |joint − target|² + (0.1 m/rad)² Σ (angle − analytic angle)², by
    Gauss-Newton.

    The sum is over ERROR_JOINTS. Frames are independent; blocks of frames limit the Jacobian's memory.
    """
    measured = [JOINT_NAMES.index(name) for name in ERROR_JOINTS]
    regularisation = np.full(poses.shape[1], _REGULARISATION_M_PER_RAD**2)
    regularisation[:3] = 0.0  # the pelvis position is free
    blocks = []
    for start in range(0, len(poses), 1000):
        analytic, block_targets = poses[start : start + 1000], targets[start : start + 1000]
        refined = analytic
        for _ in range(3):  # the initial error is a few degrees: the third step is below 0.01 degrees
            jacobian = joint_jacobian(skeleton, refined)[:, measured].reshape(len(refined), -1, poses.shape[1])
            residual = (block_targets - joints(skeleton, refined))[:, measured].reshape(len(refined), -1)
            gradient = np.einsum("frp,fr->fp", jacobian, residual) - regularisation * (refined - analytic)
            normal = jacobian.swapaxes(1, 2) @ jacobian + np.diag(regularisation)
            refined = refined + np.linalg.solve(normal, gradient[..., None])[..., 0]
        blocks.append(refined)
    return np.concatenate(blocks)
