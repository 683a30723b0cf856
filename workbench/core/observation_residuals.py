"""What points and keypoints of one frame say about a pose, as residual functions (see `residual`)."""

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface, nearest_residual_jacobian
from workbench.core.residual import ResidualFunction, nothing


def surface_residual(
    skeleton: Skeleton, surface: Surface, points: FloatArray, kind: Kind, sigma: float
) -> ResidualFunction:
    """Measure how far points (K, 3), m, are off the surface, over `sigma`: m for kind "distance", the field's unit for
    "field".

    Every point belongs to the part of the body that is nearest in the pose asked for (paper D, eq. 5, 6), so that the
    cost is the distance to the nearest part, and a step that is accepted never raises it.
    """
    if not len(points):
        return nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = nearest_residual_jacobian(skeleton, surface, pose, points, kind)
        misses /= sigma
        slopes *= 1.0 / sigma
        return misses, slopes

    return residual


def keypoint_residual(
    skeleton: Skeleton, camera: Camera, joints: IntArray, marks: FloatArray, sigma_px: float
) -> ResidualFunction:
    """Measure how far joints (K,) are off the pixels where they were marked or detected, marks (K, 3) [u px, v px,
    weight 0..1]; 2 K residuals.

    The standard deviation is sigma_px over the root of the weight. A joint behind the camera counts as 1000 deviations
    away. The derivative leaves the lens' distortion out, the residual does not.
    """
    if not len(marks):
        return nothing
    whitening = np.sqrt(marks[:, 2:]) / sigma_px

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = forward(skeleton, pose[None]).positions[0, joints]
        apart = np.nan_to_num((camera.project(points) - marks[:, :2]) * whitening, nan=1e3)
        slopes = projection_jacobian(camera, points) @ joint_jacobian(skeleton, pose[None])[0, joints]
        return apart.ravel(), (slopes * whitening[:, :, None]).reshape(apart.size, -1)

    return residual


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Differentiate the pixels of world points (n, 3) by the points, (n, 2, 3), px/m, without the lens' distortion."""
    x, y, z = camera.to_camera(points).T
    zero = np.zeros_like(z)
    focal_x, focal_y = camera.matrix[0, 0], camera.matrix[1, 1]
    seen = np.array([[focal_x / z, zero, -focal_x * x / z**2], [zero, focal_y / z, -focal_y * y / z**2]])
    jacobian: FloatArray = seen.transpose(2, 0, 1) @ camera.rotation
    return jacobian
