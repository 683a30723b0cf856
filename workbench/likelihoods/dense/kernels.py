"""What is done for every cell and point, compiled; what it should give is beside those who call it, in NumPy."""

from typing import Any

import numpy as np

from workbench.body.simd_kinematics import inlined_exactly
from workbench.utils.kernel_cache import kernel

MARGIN_PX = 3
"""Points nearer to the image's edges are not looked at."""
COARSE_PX = 4
"""Width of the squares in which the nearest cell is looked for; neighbouring cells are never farther apart."""
THICK_M = 0.12
"""A cell is hidden by what lies so much nearer to the camera: less is the limb itself."""


@kernel(error_model="numpy")
def place(
    points: Any, normals: Any, joints: Any, rotations: Any, positions: Any, eye: Any, camera: Any,
    places: Any, facing: Any, depth: Any, pixels: Any,
) -> None:  # fmt: skip
    """Write where points (S, 3) with normals (S, 3) are in a pose, given by its joints' frames: places (S, 3), m,
    cosines (S,) to the line of sight from `eye` (3,), depths (S,), m, and pixels (S, 2), NaN behind the camera."""
    for s in range(points.shape[0]):
        turn, origin, own, normal = rotations[joints[s]], positions[joints[s]], points[s], normals[s]
        towards, square, across = 0.0, 0.0, 0.0
        for a in range(3):
            places[s, a] = turn[a, 0] * own[0] + turn[a, 1] * own[1] + turn[a, 2] * own[2] + origin[a]
            towards = eye[a] - places[s, a]
            square += towards * towards
            across += towards * (turn[a, 0] * normal[0] + turn[a, 1] * normal[1] + turn[a, 2] * normal[2])
        facing[s] = across / np.sqrt(square)
        x, y, z = places[s, 0], places[s, 1], places[s, 2]
        depth[s] = camera[6] * x + camera[7] * y + camera[8] * z + camera[11]
        near = depth[s] if depth[s] > 1e-6 else np.nan
        u = (camera[0] * x + camera[1] * y + camera[2] * z + camera[9]) / near
        v = (camera[3] * x + camera[4] * y + camera[5] * z + camera[10]) / near
        r2 = u * u + v * v
        radial = 1.0 + r2 * (camera[16] + r2 * (camera[17] + r2 * camera[20]))
        bent_u = u * radial + 2.0 * camera[18] * u * v + camera[19] * (r2 + 2.0 * u * u)
        bent_v = v * radial + camera[18] * (r2 + 2.0 * v * v) + 2.0 * camera[19] * u * v
        pixels[s, 0], pixels[s, 1] = bent_u * camera[12] + camera[14], bent_v * camera[13] + camera[15]


@kernel(error_model="numpy")
def see(pixels: Any, depth: Any, facing: Any, height: int, width: int, least_facing: float) -> Any:
    """List the cells that are seen, see `cells.visible`."""
    front, n = np.empty(len(depth), dtype=np.int64), 0
    nearest = np.full((height // COARSE_PX + 1, width // COARSE_PX + 1), np.inf)
    for s in range(len(depth)):
        x, y = pixels[s, 0], pixels[s, 1]
        inside = x > MARGIN_PX and y > MARGIN_PX and x < width - 1 - MARGIN_PX and y < height - 1 - MARGIN_PX
        if inside and facing[s] > 0.0:
            front[n] = s
            n += 1
            row, column = int(y / COARSE_PX), int(x / COARSE_PX)
            nearest[row, column] = min(nearest[row, column], depth[s])
    seen, k = np.empty(n, dtype=np.int64), 0
    for i in range(n):
        s = front[i]
        if not facing[s] > least_facing:
            continue
        row, column, limit = int(pixels[s, 1] / COARSE_PX), int(pixels[s, 0] / COARSE_PX), np.inf
        for r in range(max(row - 1, 0), min(row + 2, nearest.shape[0])):
            for c in range(max(column - 1, 0), min(column + 2, nearest.shape[1])):
                limit = min(limit, nearest[r, c])
        if not depth[s] > limit + THICK_M:
            seen[k] = s
            k += 1
    return seen[:k]


@kernel(error_model="numpy")
def place_beside(
    starts: Any, ends: Any, radii: Any, spheres: Any, eye: Any, focal_px: float, distances_px: Any, along: int,
    points: Any,
) -> None:  # fmt: skip
    """Write points (L, K, 3) beside limbs from `starts` to `ends` (L, 3), see `beside.beside`."""
    n = 2 * along
    edge, out, side, sight, over = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(starts)):
        if spheres[k]:
            sight[:] = eye - starts[k]
            _to_unit(sight)
            side[0], side[1], side[2] = sight[1], -sight[0], 0.0
            _to_unit(side)
            _cross(sight, side, over)
        for i in range(n):
            if spheres[k]:
                angle = np.pi * i / along
                for a in range(3):
                    out[a] = np.cos(angle) * side[a] + np.sin(angle) * over[a]
                    edge[a] = starts[k, a] + radii[k, 0] * out[a]
            else:
                u = (i % along + 0.5) / along
                for a in range(3):
                    edge[a] = starts[k, a] + u * (ends[k, a] - starts[k, a])
                    over[a], sight[a] = ends[k, a] - starts[k, a], eye[a] - edge[a]
                _cross(over, sight, out)
                _to_unit(out)
                for a in range(3):
                    out[a] = out[a] if i < along else -out[a]
                    edge[a] += (radii[k, 0] + (radii[k, 1] - radii[k, 0]) * u) * out[a]
            away = np.sqrt((edge[0] - eye[0]) ** 2 + (edge[1] - eye[1]) ** 2 + (edge[2] - eye[2]) ** 2)
            for j in range(len(distances_px)):
                for a in range(3):
                    points[k, j * n + i, a] = edge[a] + distances_px[j] * away / focal_px * out[a]


@inlined_exactly
def _cross(a: Any, b: Any, out: Any) -> None:
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined_exactly
def _to_unit(vector: Any) -> None:
    length = max(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2), 1e-9)
    for a in range(3):
        vector[a] /= length


@kernel(error_model="numpy")
def ratio_to_scene(
    first: int, last: int, image: Any, level: Any, n: Any, noise: float, outlier_fraction: float, found: Any
) -> None:
    """Write rows `first` to `last` of log ratios (height, width), see `scene.Scene.log_ratio`."""
    for y in range(first, last):
        for x in range(image.shape[1]):
            found[y, x] = 0.0
            if n[y, x] > 0.0:
                sigma = noise * np.sqrt(1.0 + 1.0 / max(n[y, x], 1.0))
                miss = (image[y, x] - level[y, x]) / sigma
                normal = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * miss * miss)
                found[y, x] = -np.log(outlier_fraction + (1.0 - outlier_fraction) * normal)


@kernel(error_model="numpy")
def learn_scene(first: int, last: int, image: Any, near: Any, most: float, least: float, level: Any, n: Any) -> None:
    """Learn rows `first` to `last` of a scene in place, see `scene.Scene.seen`."""
    for y in range(first, last):
        for x in range(image.shape[1]):
            apart = image[y, x] - level[y, x]
            known = n[y, x] > 0.0
            if not near[y, x] and (not known or (abs(apart) < least and n[y, x] < most)):
                n[y, x] += 1.0
                level[y, x] += apart / n[y, x]


@kernel(error_model="numpy")
def sample(image: Any, pixels: Any, values: Any, gradients: Any) -> None:
    """Write values (K,) and gradients (K, 2) of an image at pixels (K, 2), see `pictures.Picture.at`."""
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
def turn_axes(pose: Any, parents: Any, dof_joints: Any, dof_axes: Any, rotations: Any, axes: Any) -> None:
    """Write the world directions (P, 3) of a pose's axes, as `kinematics.world_axes`, from its joints' rotations."""
    turned = np.empty((3, 3))
    last = -1
    for p in range(len(pose)):
        ax, ay, az = dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2]
        if p < 3:
            axes[p] = dof_axes[p]
            continue
        joint = dof_joints[p]
        if joint != last:
            turned[:] = rotations[parents[joint]] if parents[joint] >= 0 else np.eye(3)
            last = joint
        s, c = np.sin(pose[p]), np.cos(pose[p])
        t = 1.0 - c
        for a in range(3):
            r0, r1, r2 = turned[a, 0], turned[a, 1], turned[a, 2]
            axes[p, a] = r0 * ax + r1 * ay + r2 * az
            turned[a, 0] = r0 * (c + t * ax * ax) + r1 * (t * ax * ay + s * az) + r2 * (t * ax * az - s * ay)
            turned[a, 1] = r0 * (t * ax * ay - s * az) + r1 * (c + t * ay * ay) + r2 * (t * ay * az + s * ax)
            turned[a, 2] = r0 * (t * ax * az + s * ay) + r1 * (t * ay * az - s * ax) + r2 * (c + t * az * az)


@kernel(error_model="numpy")
def add_normal(
    misses: Any, gradients: Any, points: Any, joints: Any, counts: Any, bend: float, camera: Any, axes: Any,
    moments: Any, moves: Any, gradient: Any, curvature: Any,
) -> None:  # fmt: skip
    """Add up the gradient (P,) and the curvature (P, P) of the loss of points (K, 3), see `sight.Residuals.normal`."""
    n = len(gradient)
    slopes, own, n_own = np.empty(n), np.empty(moves.shape, dtype=np.int64), np.zeros(len(moves), dtype=np.int64)
    for joint in range(len(moves)):  # which numbers of the pose move it
        for p in range(n):
            if moves[joint, p] > 0.0:
                own[joint, n_own[joint]] = p
                n_own[joint] += 1
    for i in range(len(misses)):
        if not counts[i] > 0.0:
            continue
        weight = counts[i] / (1.0 + (misses[i] / bend) ** 2) ** 2
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
        movers = own[joints[i], : n_own[joints[i]]]
        for a in range(len(movers)):
            p = movers[a]
            if p < 3:
                slope = fx if p == 0 else (fy if p == 1 else fz)
            else:
                slope = axes[p, 0] * tx + axes[p, 1] * ty + axes[p, 2] * tz
                slope -= moments[p, 0] * fx + moments[p, 1] * fy + moments[p, 2] * fz
            slopes[a] = slope
            weighted, row = weight * slope, curvature[p]
            gradient[p] += weighted * misses[i]
            for b in range(a + 1):
                row[movers[b]] += weighted * slopes[b]
    for a in range(n):
        for b in range(a):
            curvature[b, a] = curvature[a, b]
