"""Compiled loops over surface elements, points and pixels; their callers define the results."""

from typing import Any

import numpy as np

from workbench.body.simd_kinematics import inlined_exactly
from workbench.utils.kernel_cache import kernel

MARGIN_PX = 3
"""Points closer to the image's edges are ignored."""
COARSE_PX = 4
"""Width of the squares for the nearest depth; neighbouring elements are never farther apart."""
THICK_M = 0.12
"""An element is hidden if something is at least this much closer to the camera; smaller differences are within the
limb."""


@kernel(error_model="numpy")
def project(
    points: Any, normals: Any, joints: Any, rotations: Any, positions: Any, camera_position: Any, camera: Any,
    places: Any, facing: Any, depth: Any, pixels: Any,
) -> None:  # fmt: skip
    """Write the places of points (S, 3) with normals (S, 3) in a pose, given by its joints' frames. Results: places (S,
    3), m, cosines (S,) to the line of sight from the camera's position (3,), depths (S,), m, and pixels (S, 2), NaN
    behind the camera."""
    for s in range(points.shape[0]):
        rotation, origin, point, normal = rotations[joints[s]], positions[joints[s]], points[s], normals[s]
        to_camera, squared_distance, dot = 0.0, 0.0, 0.0
        for a in range(3):
            places[s, a] = rotation[a, 0] * point[0] + rotation[a, 1] * point[1] + rotation[a, 2] * point[2] + origin[a]
            to_camera = camera_position[a] - places[s, a]
            squared_distance += to_camera * to_camera
            dot += to_camera * (rotation[a, 0] * normal[0] + rotation[a, 1] * normal[1] + rotation[a, 2] * normal[2])
        facing[s] = dot / np.sqrt(squared_distance)
        x, y, z = places[s, 0], places[s, 1], places[s, 2]
        depth[s] = camera[6] * x + camera[7] * y + camera[8] * z + camera[11]
        positive_depth = depth[s] if depth[s] > 1e-6 else np.nan
        u = (camera[0] * x + camera[1] * y + camera[2] * z + camera[9]) / positive_depth
        v = (camera[3] * x + camera[4] * y + camera[5] * z + camera[10]) / positive_depth
        r2 = u * u + v * v
        radial = 1.0 + r2 * (camera[16] + r2 * (camera[17] + r2 * camera[20]))
        distorted_u = u * radial + 2.0 * camera[18] * u * v + camera[19] * (r2 + 2.0 * u * u)
        distorted_v = v * radial + camera[18] * (r2 + 2.0 * v * v) + 2.0 * camera[19] * u * v
        pixels[s, 0], pixels[s, 1] = distorted_u * camera[12] + camera[14], distorted_v * camera[13] + camera[15]


@kernel(error_model="numpy")
def visible_elements_kernel(
    pixels: Any, depth: Any, facing: Any, height: int, width: int, min_facing_cosine: float
) -> Any:
    """Return the visible elements, see `surface_elements.visible_elements`."""
    facing_elements, n = np.empty(len(depth), dtype=np.int64), 0
    nearest = np.full((height // COARSE_PX + 1, width // COARSE_PX + 1), np.inf)
    for s in range(len(depth)):
        x, y = pixels[s, 0], pixels[s, 1]
        inside = x > MARGIN_PX and y > MARGIN_PX and x < width - 1 - MARGIN_PX and y < height - 1 - MARGIN_PX
        if inside and facing[s] > 0.0:
            facing_elements[n] = s
            n += 1
            row, column = int(y / COARSE_PX), int(x / COARSE_PX)
            nearest[row, column] = min(nearest[row, column], depth[s])
    visible, k = np.empty(n, dtype=np.int64), 0
    for i in range(n):
        s = facing_elements[i]
        if not facing[s] > min_facing_cosine:
            continue
        row, column, limit = int(pixels[s, 1] / COARSE_PX), int(pixels[s, 0] / COARSE_PX), np.inf
        for r in range(max(row - 1, 0), min(row + 2, nearest.shape[0])):
            for c in range(max(column - 1, 0), min(column + 2, nearest.shape[1])):
                limit = min(limit, nearest[r, c])
        if not depth[s] > limit + THICK_M:
            visible[k] = s
            k += 1
    return visible[:k]


@kernel(error_model="numpy")
def place_contour_samples(
    starts: Any, ends: Any, radii: Any, spheres: Any, camera_position: Any, focal_px: float, distances_px: Any,
    along: int, points: Any,
) -> None:  # fmt: skip
    """Write points (L, K, 3) outside limbs from `starts` to `ends` (L, 3), see `surface_elements.contour_samples`."""
    n_points = 2 * along
    edge, normal, side, line_of_sight, second = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(starts)):
        if spheres[k]:
            line_of_sight[:] = camera_position - starts[k]
            _to_unit(line_of_sight)
            side[0], side[1], side[2] = line_of_sight[1], -line_of_sight[0], 0.0
            _to_unit(side)
            _cross(line_of_sight, side, second)
        for i in range(n_points):
            if spheres[k]:
                angle = np.pi * i / along
                for a in range(3):
                    normal[a] = np.cos(angle) * side[a] + np.sin(angle) * second[a]
                    edge[a] = starts[k, a] + radii[k, 0] * normal[a]
            else:
                u = (i % along + 0.5) / along
                for a in range(3):
                    edge[a] = starts[k, a] + u * (ends[k, a] - starts[k, a])
                    second[a], line_of_sight[a] = ends[k, a] - starts[k, a], camera_position[a] - edge[a]
                _cross(second, line_of_sight, normal)
                _to_unit(normal)
                for a in range(3):
                    normal[a] = normal[a] if i < along else -normal[a]
                    edge[a] += (radii[k, 0] + (radii[k, 1] - radii[k, 0]) * u) * normal[a]
            dx, dy, dz = edge[0] - camera_position[0], edge[1] - camera_position[1], edge[2] - camera_position[2]
            distance = np.sqrt(dx**2 + dy**2 + dz**2)
            for j in range(len(distances_px)):
                for a in range(3):
                    points[k, j * n_points + i, a] = edge[a] + distances_px[j] * distance / focal_px * normal[a]


@inlined_exactly
def _cross(a: Any, b: Any, product: Any) -> None:
    product[0], product[1], product[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined_exactly
def _to_unit(vector: Any) -> None:
    length = max(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2), 1e-9)
    for a in range(3):
        vector[a] /= length


@kernel(error_model="numpy")
def log_ratio_rows(
    first: int, last: int, image: Any, level: Any, n: Any, noise: float, outlier_fraction: float, log_ratios: Any
) -> None:
    """Write rows `first` to `last` of log ratios (height, width), see `BackgroundModel.log_ratio`."""
    for y in range(first, last):
        for x in range(image.shape[1]):
            log_ratios[y, x] = 0.0
            if n[y, x] > 0.0:
                sigma = noise * np.sqrt(1.0 + 1.0 / max(n[y, x], 1.0))
                residual = (image[y, x] - level[y, x]) / sigma
                density = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * residual * residual)
                log_ratios[y, x] = -np.log(outlier_fraction + (1.0 - outlier_fraction) * density)


@kernel(error_model="numpy")
def update_background(
    first: int, last: int, image: Any, excluded: Any, max_frames: float, threshold: float, level: Any, n: Any
) -> None:
    """Update rows `first` to `last` of a background in place, see `BackgroundModel.updated`."""
    for y in range(first, last):
        for x in range(image.shape[1]):
            difference = image[y, x] - level[y, x]
            observed = n[y, x] > 0.0
            if not excluded[y, x] and (not observed or (abs(difference) < threshold and n[y, x] < max_frames)):
                n[y, x] += 1.0
                level[y, x] += difference / n[y, x]


@kernel(error_model="numpy")
def interpolate_rows(image: Any, pixels: Any, values: Any, gradients: Any) -> None:
    """Write values (K,) and gradients (K, 2) of an image at pixels (K, 2), see `view_likelihood.interpolate`."""
    for i in range(len(pixels)):
        column, row = int(pixels[i, 0]), int(pixels[i, 1])
        u, v = pixels[i, 0] - column, pixels[i, 1] - row
        values[i] = _between(image, row, column, u, v)
        gradients[i, 0] = 0.5 * (_between(image, row, column + 1, u, v) - _between(image, row, column - 1, u, v))
        gradients[i, 1] = 0.5 * (_between(image, row + 1, column, u, v) - _between(image, row - 1, column, u, v))


@inlined_exactly
def _between(image: Any, row: int, column: int, u: float, v: float) -> float:
    upper = (1.0 - u) * image[row, column] + u * image[row, column + 1]
    lower = (1.0 - u) * image[row + 1, column] + u * image[row + 1, column + 1]
    return float((1.0 - v) * upper + v * lower)


@kernel(error_model="numpy")
def rotation_axes(pose: Any, parents: Any, dof_joints: Any, dof_axes: Any, rotations: Any, axes: Any) -> None:
    """Write the world directions (P, 3) of a pose's axes, as `kinematics.world_axes`, from its joints' rotations."""
    rotation = np.empty((3, 3))
    last = -1
    for p in range(len(pose)):
        ax, ay, az = dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2]
        if p < 3:
            axes[p] = dof_axes[p]
            continue
        joint = dof_joints[p]
        if joint != last:
            rotation[:] = rotations[parents[joint]] if parents[joint] >= 0 else np.eye(3)
            last = joint
        s, c = np.sin(pose[p]), np.cos(pose[p])
        t = 1.0 - c
        for a in range(3):
            r0, r1, r2 = rotation[a, 0], rotation[a, 1], rotation[a, 2]
            axes[p, a] = r0 * ax + r1 * ay + r2 * az
            rotation[a, 0] = r0 * (c + t * ax * ax) + r1 * (t * ax * ay + s * az) + r2 * (t * ax * az - s * ay)
            rotation[a, 1] = r0 * (t * ax * ay - s * az) + r1 * (c + t * ay * ay) + r2 * (t * ay * az + s * ax)
            rotation[a, 2] = r0 * (t * ax * az + s * ay) + r1 * (t * ay * az - s * ax) + r2 * (c + t * az * az)


@kernel(error_model="numpy")
def add_normal_equations(
    values: Any, gradients: Any, points: Any, joints: Any, weights: Any, loss_scale: float, camera: Any, axes: Any,
    moments: Any, dof_mask: Any, gradient: Any, curvature: Any,
) -> None:  # fmt: skip
    """Add the gradient (P,) and the curvature (P, P) of the loss of points (K, 3), see `Residuals.normal_equations`."""
    n = len(gradient)
    derivatives, movers_of = np.empty(n), np.empty(dof_mask.shape, dtype=np.int64)
    n_movers = np.zeros(len(dof_mask), dtype=np.int64)
    for joint in range(len(dof_mask)):  # which numbers of the pose move it
        for p in range(n):
            if dof_mask[joint, p] > 0.0:
                movers_of[joint, n_movers[joint]] = p
                n_movers[joint] += 1
    for i in range(len(values)):
        if not weights[i] > 0.0:
            continue
        weight = weights[i] / (1.0 + (values[i] / loss_scale) ** 2) ** 2
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        cx = camera[0] * x + camera[1] * y + camera[2] * z + camera[9]
        cy = camera[3] * x + camera[4] * y + camera[5] * z + camera[10]
        cz = camera[6] * x + camera[7] * y + camera[8] * z + camera[11]
        gx, gy = gradients[i, 0] * camera[12] / cz, gradients[i, 1] * camera[13] / cz
        gz = -(gx * cx + gy * cy) / cz
        fx = gx * camera[0] + gy * camera[3] + gz * camera[6]
        fy = gx * camera[1] + gy * camera[4] + gz * camera[7]
        fz = gx * camera[2] + gy * camera[5] + gz * camera[8]
        tx, ty, tz = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
        movers = movers_of[joints[i], : n_movers[joints[i]]]
        for a in range(len(movers)):
            p = movers[a]
            if p < 3:
                derivative = fx if p == 0 else (fy if p == 1 else fz)
            else:
                derivative = axes[p, 0] * tx + axes[p, 1] * ty + axes[p, 2] * tz
                derivative -= moments[p, 0] * fx + moments[p, 1] * fy + moments[p, 2] * fz
            derivatives[a] = derivative
            weighted, row = weight * derivative, curvature[p]
            gradient[p] += weighted * values[i]
            for b in range(a + 1):
                row[movers[b]] += weighted * derivatives[b]
    for a in range(n):
        for b in range(a):
            curvature[b, a] = curvature[a, b]
