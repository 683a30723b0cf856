"""Smallest depths of bones in plain NumPy, bone by bone, for `least_squares.video.landmark_depths`."""

import numpy as np

from workbench.body.kinematics import forward, joint_jacobian
from workbench.core.residual import ResidualFunction


def depth_residual(skeleton, view, bones, sigma_m) -> ResidualFunction:
    """Return the residual √w (d · (x_b − x_a) − L Δz / |Δ|) / σ of bones (a, b) by name, with its Jacobian.

    The residual is 0 if the bone is deeper than the world landmarks' L Δz / |Δ|, or if that is below 0.08 m. d is the
    direction to the mean of the undistorted keypoints, L the bone's length, w the lower weight of its ends.
    """
    rays = [*view.camera.undistorted(view.detections[:, :2]).mean(axis=0), 1.0]
    direction = view.camera.rotation.T @ (np.array(rays) / np.linalg.norm(rays))
    places = dict(zip(view.joints.tolist(), view.world_landmarks, strict=True))
    weights = dict(zip(view.joints.tolist(), view.detections[:, 2], strict=True))

    def residual(pose):
        values, rows = [], []
        positions, jacobian = forward(skeleton, pose[None]).positions[0], joint_jacobian(skeleton, pose[None])[0]
        for a, b in ((skeleton.joint(first), skeleton.joint(last)) for first, last in bones):
            if a in places and b in places:
                length = np.linalg.norm(positions[b] - positions[a])
                bone = places[b] - places[a]
                whitening = np.sqrt(min(weights[a], weights[b])) / sigma_m
                depth, predicted = length * bone[2] / np.linalg.norm(bone), direction @ (positions[b] - positions[a])
                weight = whitening if abs(depth) > 0.08 and abs(depth) > np.sign(depth) * predicted else 0.0
                values.append(weight * (predicted - depth))
                rows.append(weight * direction @ (jacobian[b] - jacobian[a]))
        return np.array(values), np.array(rows).reshape(-1, len(pose))

    return residual
