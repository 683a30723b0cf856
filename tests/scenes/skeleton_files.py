"""BVH files of a walker with the joint names of other programs."""

from functools import cache

import numpy as np
import scipy

from workbench.body.skeleton import person_skeleton
from workbench.motion.formats.bvh import bvh_text, read_bvh
from workbench.motion.synthetic.gait import subjects, walker


def _sides(left, right, **parts):
    return {f"{side}_{joint}": name.format(prefix) for side, prefix in (("left", left), ("right", right))
            for joint, name in parts.items()}  # fmt: skip


STYLES = {
    "motionbuilder": {"pelvis": "Hips", "neck": "Neck", "head": "Head", **_sides(
        "Left", "Right", clavicle="{}Shoulder", shoulder="{}Arm", elbow="{}ForeArm", wrist="{}Hand", hip="{}UpLeg",
        knee="{}Leg", ankle="{}Foot")},
    "rokoko": {"pelvis": "Hips", "neck": "Neck", "head": "Head", **_sides(
        "Left", "Right", clavicle="{}Shoulder", shoulder="{}Arm", elbow="{}ForeArm", wrist="{}Hand", hip="{}Thigh",
        knee="{}Shin", ankle="{}Foot")},
    "xsens": {"pelvis": "Hips", "neck": "Neck", "head": "Head", **_sides(
        "Left", "Right", clavicle="{}Collar", shoulder="{}Shoulder", elbow="{}Elbow", wrist="{}Wrist", hip="{}Hip",
        knee="{}Knee", ankle="{}Ankle")},
    "daz": {"pelvis": "hip", "neck": "neck", "head": "head", **_sides(
        "l", "r", clavicle="{}Collar", shoulder="{}Shldr", elbow="{}ForeArm", wrist="{}Hand", hip="{}Thigh",
        knee="{}Shin", ankle="{}Foot")},
    "motive": {"pelvis": "Hip", "neck": "Neck", "head": "Head", **_sides(
        "L", "R", clavicle="{}Shoulder", shoulder="{}UArm", elbow="{}FArm", wrist="{}Hand", hip="{}Thigh",
        knee="{}Shin", ankle="{}Foot")},
    "unreal": {"pelvis": "pelvis", "neck": "neck_01", "head": "head", **_sides(
        "l", "r", clavicle="clavicle_{}", shoulder="upperarm_{}", elbow="lowerarm_{}", wrist="hand_{}", hip="thigh_{}",
        knee="calf_{}", ankle="foot_{}")},
    "blender": {"pelvis": "spine", "neck": "neck", "head": "head", **_sides(
        "L", "R", clavicle="shoulder.{}", shoulder="upper_arm.{}", elbow="forearm.{}", wrist="hand.{}", hip="thigh.{}",
        knee="shin.{}", ankle="foot.{}")},
    "smpl": {"pelvis": "Pelvis", "neck": "Neck", "head": "Head", **_sides(
        "L", "R", clavicle="{}_Collar", shoulder="{}_Shoulder", elbow="{}_Elbow", wrist="{}_Wrist", hip="{}_Hip",
        knee="{}_Knee", ankle="{}_Ankle")},
    "biped": {"pelvis": "Bip01 Pelvis", "neck": "Bip01 Neck", "head": "Bip01 Head", **_sides(
        "L", "R", clavicle="Bip01 {} Clavicle", shoulder="Bip01 {} UpperArm", elbow="Bip01 {} Forearm",
        wrist="Bip01 {} Hand", hip="Bip01 {} Thigh", knee="Bip01 {} Calf", ankle="Bip01 {} Foot")},
    "vrm": {"pelvis": "J_Bip_C_Hips", "neck": "J_Bip_C_Neck", "head": "J_Bip_C_Head", **_sides(
        "L", "R", clavicle="J_Bip_{}_Shoulder", shoulder="J_Bip_{}_UpperArm", elbow="J_Bip_{}_LowerArm",
        wrist="J_Bip_{}_Hand", hip="J_Bip_{}_UpperLeg", knee="J_Bip_{}_LowerLeg", ankle="J_Bip_{}_Foot")},
    "bandai": {"pelvis": "Hips", "neck": "Neck", "head": "Head", **_sides(
        "L", "R", clavicle="Shoulder_{}", shoulder="UpperArm_{}", elbow="LowerArm_{}", wrist="Hand_{}",
        hip="UpperLeg_{}", knee="LowerLeg_{}", ankle="Foot_{}")},
}  # fmt: skip
for _prefix in ("mixamorig:", "mixamorig", "Anna:", "Skeleton_", "Skeleton 001:"):
    STYLES[_prefix] = {joint: f"{_prefix}{name}" for joint, name in STYLES["motionbuilder"].items()}
STYLES["jnt"] = {joint: f"{name}_JNT" for joint, name in STYLES["motionbuilder"].items()}
_ENDS = {"head": "neck_end"} | {f"{side}_{leaf}": f"{side}_{parent}_end" for side in ("left", "right")
                                for leaf, parent in (("wrist", "elbow"), ("ankle", "knee"))}  # fmt: skip


@cache
def walk():
    """Return a generated walk of two seconds at 30 Hz."""
    (subject,) = subjects(1, np.random.default_rng(5))
    return walker(subject, 2.0, 30.0)


def walk_bvh(folder, style="motionbuilder", unit=100.0, up="y", seed=None, lines=lambda text: text):
    """Write the walk with a style's joints and return the file.

    unit : units per metre. seed : of random constant rotations of every joint's frame, or None. lines : function that
    changes the text.
    """
    motion = walk()
    own = folder / "own.bvh"
    own.write_text(bvh_text(person_skeleton(motion.shape), motion.poses, 30.0))
    clip, names = read_bvh(own, "cm", "y"), STYLES[style]
    n, order = len(clip.joints), {"y": [1, 2, 0], "z": [0, 1, 2]}[up]
    own_names = {joint: _ENDS.get(joint, joint) for joint in names}
    frames = np.broadcast_to(np.eye(3), (n, 3, 3)) if seed is None else (
        scipy.spatial.transform.Rotation.random(n, random_state=seed).as_matrix())  # fmt: skip
    parent_frames = np.array([np.eye(3) if parent < 0 else frames[parent] for parent in clip.parents])
    rotations = np.swapaxes(parent_frames, 1, 2) @ clip.rotations @ frames
    offsets = unit * np.einsum("kba,kb->ka", parent_frames, clip.offsets)[:, order]
    angles = scipy.spatial.transform.Rotation.from_matrix(rotations[..., order, :][..., order].reshape(-1, 3, 3))
    angles = angles.as_euler("ZXY", degrees=True).reshape(len(clip), n, 3)
    text = ["HIERARCHY", *_branch(clip, 0, {own: names[joint] for joint, own in own_names.items()}, offsets), "MOTION"]
    text += [f"Frames: {len(clip)}", "Frame Time: 0.0333333"]
    depth_first = _depth_first(clip, 0)
    for position, turns in zip(unit * clip.positions[:, 0][:, order], angles, strict=True):
        text.append(" ".join(f"{x:.6f}" for x in [*position, *turns[depth_first].ravel()]))
    path = folder / "walk.bvh"
    path.write_text(lines("\n".join([*text, ""])))
    own.unlink()
    return path


def _depth_first(clip, joint):
    return [joint, *[k for child in np.flatnonzero(clip.parents == joint) for k in _depth_first(clip, child)]]


def _branch(clip, joint, names, offsets):
    offset = " ".join(f"{x:.6f}" for x in offsets[joint])
    text = [f"{'JOINT' if joint else 'ROOT'} {names[clip.joints[joint]]}", "{", f"OFFSET {offset}"]
    translation = "Xposition Yposition Zposition " if joint == 0 else ""
    text.append(f"CHANNELS {6 if translation else 3} {translation}Zrotation Xrotation Yrotation")
    children = np.flatnonzero(clip.parents == joint)
    for child in children:
        text += _branch(clip, child, names, offsets)
    return [*text, *([] if len(children) else ["End Site", "{", "OFFSET 0 0 0", "}"]), "}"]
