"""Initial poses of every frame from a detector's world landmarks, for a single camera.

Landmarks give the directions of torso and limbs frame by frame, without the ambiguity of the image; lengths are the
person's own, and the position is that of the keypoints' rays.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.observations import Keypoints, Observed
from workbench.inference.least_squares.video.landmark_depths import landmark_places
from workbench.inference.least_squares.video.pose_problem import reach_in_sequence
from workbench.utils.arrays import FloatArray

TORSO = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
LIMB_SIGMA_M = 0.03
"""Standard deviation of the joints from the directions by the landmarks, against nominal angles."""
MEDIAN_WINDOW_S = 0.5
"""Duration over which a torso's rotation is the median of the frames': longer than a detector's confusions of front and
back, shorter than a half turn, which takes people about a second."""


def landmark_paths(skeleton: Skeleton, observations: Sequence[Observed], times_s: FloatArray) -> FloatArray | None:
    """Return the paths (2, T, P) of `landmark_poses`, as observed and mirrored in depth; None without landmarks."""
    paths = [landmark_poses(skeleton, observations, times_s, mirrored) for mirrored in (False, True)]
    return np.stack([path for path in paths if path is not None]) if paths[0] is not None else None


def landmark_poses(
    skeleton: Skeleton, observations: Sequence[Observed], times_s: FloatArray, mirrored: bool = False
) -> FloatArray | None:
    """Return poses (T, P) of all frames by the world landmarks of a single camera, or None without any.

    The root's rotation is the median over MEDIAN_WINDOW_S of the rotations that align the skeleton's shoulders and hips
    with the landmarks' (Kabsch 1976). Limbs have the landmarks' directions as far as the limits allow, and the person's
    own lengths. The root's position is the linear least-squares solution for the keypoints' rays. Frames without
    landmarks of the torso are interpolated.

    Parameters
    ----------
    observations : of T frames with at most one view each.
    times_s : (T,), increasing.
    mirrored : reflect the landmarks in depth, the other pose with about the same image.
    """
    frames = [t for t, frame in enumerate(observations) if _shows_torso(skeleton, frame)]
    if not frames:
        return None
    views = [observations[t].keypoints[0] for t in frames]
    places = np.array([landmark_places(skeleton, view, mirrored) for view in views])
    rotations = median_rotations(torso_rotations(skeleton, places), times_s[frames])
    poses = np.zeros((len(frames), len(skeleton.dof_names)))
    poses[:, N_ROOT:] = reach_in_sequence(skeleton, _limb_targets(skeleton, places @ rotations), LIMB_SIGMA_M)[
        :, N_ROOT:
    ]
    poses[:, 3:N_ROOT] = _euler_angles(rotations)
    for pose, view in zip(poses, views, strict=True):
        pose[:3] = _position(skeleton, view, pose)
    return np.column_stack([np.interp(times_s, times_s[frames], column) for column in poses.T])


def torso_rotations(skeleton: Skeleton, places: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from the pelvis' frame to that of joints (n, J, 3), by shoulders and hips."""
    torso = [skeleton.joint(name) for name in TORSO]
    rest = joints(skeleton, np.zeros((1, len(skeleton.dof_names))))[0, torso]
    observed = places[:, torso]
    covariances = (observed - observed.mean(axis=1, keepdims=True)).swapaxes(1, 2) @ (rest - rest.mean(axis=0))
    left, _, right = np.linalg.svd(covariances)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)


def median_rotations(rotations: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) at increasing times (n,), each replaced by that within half of MEDIAN_WINDOW_S which
    has the smallest sum of angles to all others there."""
    first, end = np.searchsorted(times_s, times_s + MEDIAN_WINDOW_S * np.array([[-1.0], [1.0]]))  # wide enough
    medians = np.empty_like(rotations)
    for t, window in enumerate(map(slice, first, end)):
        near = rotations[window][np.abs(times_s[window] - times_s[t]) <= 0.5 * MEDIAN_WINDOW_S]
        cosines = np.einsum("iab,jab->ij", near, near) - 1.0
        angles = np.arccos(np.clip(0.5 * cosines, -1.0, 1.0))
        medians[t] = near[angles.sum(axis=1).argmin()]
    return medians


def _shows_torso(skeleton: Skeleton, frame: Observed) -> bool:
    views = [view for view in frame.keypoints if view.world_landmarks is not None]
    return bool(views) and {skeleton.joint(name) for name in TORSO} <= set(views[0].joints.tolist())


def _limb_targets(skeleton: Skeleton, places: FloatArray) -> FloatArray:
    """Return positions (n, J, 3) of the joints in the pelvis' frame, with the skeleton's lengths and the directions of
    landmarks (n, J, 3) in that frame; bones of the torso and without landmarks are at rest."""
    targets = np.zeros_like(places)
    for parent, child in skeleton.bones:
        offset = skeleton.offsets[child]
        bone = np.broadcast_to(offset, targets[:, child].shape)
        if parent != 0:
            direction = places[:, child] - places[:, parent]
            length = np.linalg.norm(direction, axis=1, keepdims=True)
            bone = np.where(length > 0.0, np.linalg.norm(offset) * direction / np.maximum(length, 1e-9), bone)
        targets[:, child] = targets[:, parent] + bone
    return targets


def _euler_angles(rotations: FloatArray) -> FloatArray:
    """Return heading, pitch and roll (n, 3) of rotations Rz Ry Rx (n, 3, 3), heading and roll without jumps."""
    heading = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    pitch = -np.arcsin(np.clip(rotations[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2])
    return np.column_stack([np.unwrap(heading), pitch, np.unwrap(roll)])


def _position(skeleton: Skeleton, view: Keypoints, pose: FloatArray) -> FloatArray:
    """Return the root's position (3,), m, at which the joints of a pose (P,) are nearest to the keypoints' rays."""
    camera, body = view.camera, joints(skeleton, np.concatenate([np.zeros(3), pose[3:]])[None])[0, view.joints]
    weights = np.sqrt(view.detections[:, 2])[:, None]
    normalized = camera.undistorted(view.detections[:, :2])
    # x − a z = 0 and y − b z = 0 in the camera's frame, for a ray through (a, b, 1)
    rows = camera.rotation[None, :2] - normalized[:, :, None] * camera.rotation[2]
    offsets = (rows @ (body - camera.position)[:, :, None])[:, :, 0]
    return np.linalg.lstsq((rows * weights[:, :, None]).reshape(-1, 3), -(offsets * weights).ravel(), rcond=None)[0]
