"""The alignment's cells, outlines, scenes, layers and derivatives in NumPy, for `workbench.likelihoods.dense`.

S cells or K points, P degrees of freedom, images (height, width). Frames are those of one pose, (1, J, ...).
"""

from dataclasses import replace

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.core.residual import projection_jacobian
from workbench.likelihoods.dense.background_model import DILATION_PX, MAX_FRAMES, MIN_NOISE, BackgroundModel, dilated
from workbench.likelihoods.dense.kernels import COARSE_PX, THICK_M
from workbench.likelihoods.dense.layer_rendering import OUTLIER_FRACTION, Facets, Layer, LayerImage
from workbench.likelihoods.dense.surface_elements import (
    N_CONTOUR_POINTS,
    PointMotion,
    ProjectedElements,
    SurfaceElements,
    inside,
)
from workbench.likelihoods.dense.view_likelihood import Residuals
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray

STEPS = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])[:, None]
NEAREST_M, LARGEST_PX = 0.05, 200.0
"""The least depth and the largest extent of a facet that is drawn."""


def project_elements(cells: SurfaceElements, frames: JointFrames, camera: Camera) -> ProjectedElements:
    """Place cells in a pose before a camera.

    Parameters
    ----------
    cells : Cells
        Points (S, 3), m, and normals (S, 3) in their joints' frames.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera.

    Returns
    -------
    Placed
        Points (S, 3), m, cosines of the angle to the line of sight (S,), depths (S,), m, and pixels (S, 2).
    """
    turned = frames.rotations[0][cells.joints]
    points = np.einsum("sij,sj->si", turned, cells.points) + frames.positions[0][cells.joints]
    towards = camera.position - points
    facing = np.einsum("sij,sj,si->s", turned, cells.normals, towards) / np.linalg.norm(towards, axis=1)
    seen = camera.to_camera(points)
    return ProjectedElements(points, facing, seen[:, 2], camera.pixels(seen, 1e-6))


def visible_elements(cells: ProjectedElements, shape: tuple[int, int], least_facing: float) -> IntArray:
    """List the cells in the image that face the camera and that no other limb hides.

    Parameters
    ----------
    cells : Placed
        S cells in a pose.
    shape : (int, int)
        Height and width of the image, px.
    least_facing : float
        Cosine of the angle to the line of sight that cells must exceed.

    Returns
    -------
    (K,) array
        Visible cells.
    """
    within = inside(cells.pixels, shape)
    front = np.flatnonzero(within & (cells.facing > 0.0))
    nearest = np.full((shape[0] // COARSE_PX + 1, shape[1] // COARSE_PX + 1), np.inf)
    x, y = (cells.pixels[front] / COARSE_PX).astype(np.int64).T
    np.minimum.at(nearest, (y, x), cells.depth[front])
    nearest = np.asarray(cv2.erode(nearest, np.ones((3, 3), np.uint8)))
    hidden = cells.depth[front] > nearest[y, x] + THICK_M
    return front[~hidden & (cells.facing[front] > least_facing)]


def pixel_forces(camera: Camera, points: FloatArray, gradients: FloatArray) -> FloatArray:
    """Turn image gradients into gradients in the world.

    Parameters
    ----------
    camera : Camera
        The camera.
    points : (K, 3) array
        World points, m.
    gradients : (K, 2) array
        Derivatives by the points' pixels, 1/px.

    Returns
    -------
    (K, 3) array
        Derivatives by the points, 1/m.
    """
    return np.einsum("na,nab->nb", gradients, projection_jacobian(camera, points))


def slopes(motion: PointMotion, points: FloatArray, forces: FloatArray, joints: IntArray) -> FloatArray:
    """Differentiate by the pose what depends on points of the body.

    A turn about a through o moves x by a × (x − o), so that f changes by a · (x × f) − f · (a × o).

    Parameters
    ----------
    motion : PointMotion
        Axes and moments (P, 3), and which numbers of the pose move which joints (J, P).
    points, forces : (K, 3) arrays
        World points, m, and derivatives by them, 1/m.
    joints : (K,) array
        Joints on which the points hang.

    Returns
    -------
    (K, P) array
        Derivatives by the pose, 1/m and 1/rad.
    """
    found = np.cross(points, forces) @ motion.axes.T - forces @ motion.moments.T
    found[:, :3] = forces
    return found * motion.dof_mask[joints]


def normal(residuals: Residuals, motion: PointMotion, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Compute the normal equations of a robust loss.

    Parameters
    ----------
    residuals : Residuals
        Residuals of K points, with their gradients by the pixel.
    motion : PointMotion
        How points move with the pose.
    camera : Camera
        The camera that sees them.

    Returns
    -------
    (P,) array
        Gradient of the loss.
    (P, P) array
        Its Gauss–Newton curvature.
    """
    forces = pixel_forces(camera, residuals.points, residuals.gradients)
    weights = residuals.weights / (1.0 + (residuals.values / residuals.loss_scale) ** 2) ** 2
    rows = slopes(motion, residuals.points, forces, residuals.joints)
    weighted = rows * weights[:, None]
    return weighted.T @ residuals.values, weighted.T @ rows


def picture_at(smoothed_image: Float32Array, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interpolate an image bilinearly, and differentiate it by half the differences of what is a pixel to either side.

    Parameters
    ----------
    picture : (height, width) array
        Values.
    pixels : (K, 2) array
        x and y, px, at least 2 px inside.

    Returns
    -------
    (K,) array
        Values.
    (K, 2) array
        Gradients, 1/px.
    """
    rows, columns = (pixels + STEPS).reshape(-1, 2).T[::-1]
    found = map_coordinates(smoothed_image.astype(np.float64), (rows, columns), order=1)
    here, right, left, below, above = found.reshape(5, -1)
    return here, 0.5 * np.column_stack([right - left, below - above])


def contour_samples(
    limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Place points at distances from the outlines of limbs, at their axes' depth.

    Parameters
    ----------
    limbs : Limbs
        L limbs; a section counts as a circle of its mean radius.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera that sees the outlines.
    distances_px : tuple of D floats
        Distances, px.

    Returns
    -------
    (L · 2 PLACES · D, 3) array
        Points, m; then their joints and pixels.
    """
    turned, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", turned, each) + origins for each in (limbs.starts, limbs.ends))
    edges, outwards = _edges(limbs, starts, ends, camera.position)
    metres_per_px = np.linalg.norm(edges - camera.position, axis=-1, keepdims=True) / camera.matrix[0, 0]
    points = np.concatenate([edges + distance * metres_per_px * outwards for distance in distances_px], axis=1)
    joints = np.repeat(limbs.joints, points.shape[1])
    flat = points.reshape(-1, 3)
    return flat, joints, camera.project(flat)


def _edges(limbs: Limbs, starts: FloatArray, ends: FloatArray, eye: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place points on the limbs' outlines.

    Parameters
    ----------
    limbs : Limbs
        L limbs.
    starts, ends : (L, 3) arrays
        Ends of their axes in the world, m.
    eye : (3,) array
        The camera's centre, m.

    Returns
    -------
    (L, 2 PLACES, 3) array
        Points, m.
    (L, 2 PLACES, 3) array
        Unit directions outwards.
    """
    u = ((np.arange(N_CONTOUR_POINTS) + 0.5) / N_CONTOUR_POINTS)[:, None]
    axis = starts[:, None] + (ends - starts)[:, None] * u
    side = _unit(np.cross((ends - starts)[:, None], eye - axis))
    low, high = limbs.mean_radii.T[:, :, None, None]
    radii = low + (high - low) * u
    edges, outwards = np.concatenate([axis + radii * side, axis - radii * side], axis=1), np.repeat(side, 2, axis=1)
    outwards[:, :N_CONTOUR_POINTS], outwards[:, N_CONTOUR_POINTS:] = side, -side
    balls = limbs.spheres
    sight = _unit(eye - starts[balls])
    across = _unit(np.cross(sight, [0.0, 0.0, 1.0]))
    angle = np.pi * np.arange(2 * N_CONTOUR_POINTS) / N_CONTOUR_POINTS
    around = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(sight, across)[:, None]
    outwards[balls] = around
    edges[balls] = starts[balls][:, None] + limbs.radii[balls, 0, 0][:, None, None] * around
    return edges, outwards


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def background_log_ratio(scene: BackgroundModel, image: Float32Array, epsilon: float) -> Float32Array:
    """Compute the log ratio of a person of any grey level to the scene.

    Parameters
    ----------
    scene : BackgroundModel
        Levels (height, width) and numbers of frames they are known from.
    image : (height, width) array
        Grey levels.
    epsilon : float
        Share of outliers.

    Returns
    -------
    (height, width) array
        Log ratios, 0 where the scene is unknown.
    """
    sigma = max(scene.noise, MIN_NOISE) * np.sqrt(1.0 + 1.0 / np.maximum(scene.n, 1.0))
    density = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * ((image - scene.level) / sigma) ** 2)
    return np.where(scene.observed, -np.log(epsilon + (1.0 - epsilon) * density), 0.0).astype(np.float32)


def scene_seen(scene: BackgroundModel, image: Float32Array, covered: BoolArray) -> BackgroundModel:
    """Learn a scene from one more image, except near a person and where it shows something else.

    Parameters
    ----------
    scene : BackgroundModel
        Levels (height, width) and numbers of frames they are known from.
    image : (height, width) array
        Grey levels.
    covered : (height, width) array
        Pixels that the person covers.

    Returns
    -------
    BackgroundModel
        The scene with the image's part in its means.
    """
    near = dilated(covered, DILATION_PX)
    alike = np.abs(image - scene.level) < 4.0 * max(scene.noise, MIN_NOISE)
    shown = ~near & (~scene.observed | (alike & (scene.n < MAX_FRAMES)))
    n = scene.n + shown
    return replace(scene, level=scene.level + shown * (image - scene.level) / np.maximum(n, 1.0), n=n)


def render_layer(facets: Facets, frames: JointFrames, camera: Camera, behind: Layer) -> Layer:
    """Draw facets among what is drawn already, pixel by pixel.

    Parameters
    ----------
    facets : Facets
        Quadrangles with V corners.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera.
    behind : Layer
        Cells (height, width), −1 where there is none, and their depths, m.

    Returns
    -------
    Layer
        The same with the facets.
    """
    cells, depths = behind[0].copy(), behind[1].copy()
    turned, origins = frames.rotations[0][facets.joints], frames.positions[0][facets.joints]
    points = camera.to_camera(np.einsum("kij,kj->ki", turned, facets.points) + origins)
    seen = points[facets.corners]
    y, x = np.mgrid[: cells.shape[0], : cells.shape[1]]
    for corners, cell, z in zip(camera.pixels(seen, 1e-6), facets.elements, seen[..., 2], strict=True):
        following = np.roll(corners, -1, axis=0)
        size = np.ptp(corners, axis=0).max()
        area = (corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1]).sum()
        if not (z.min() > NEAREST_M and area < 0.0 and size < LARGEST_PX):
            continue
        (ax, ay), (bx, by) = corners.T[:, :, None, None], following.T[:, :, None, None]
        within = ((bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0).all(axis=0) & (z.mean() < depths)
        cells[within], depths[within] = cell, z.mean()
    return cells, depths


def layer_log_ratio(layer: Layer, shown: LayerImage) -> float:
    """Compute the log ratio of an image with a layer to the image with the scene alone.

    Parameters
    ----------
    layer : Layer
        Cells (height, width), −1 where there is none, and their depths, m.
    shown : LayerImage
        The image and what is known of the cells and of the scene.

    Returns
    -------
    float
        Log ratio, summed over the pixels.
    """
    cells = layer[0]
    there, known = shown.unoccluded & (cells >= 0), shown.unoccluded & (cells >= 0) & (shown.n[cells] > 0.0)
    sigma = shown.sigma * np.sqrt(1.0 + 1.0 / shown.n[cells[known]])
    misses = (shown.image[known] - shown.texture[cells[known]]) / sigma
    density = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * misses**2)
    return float(shown.ratio[there].sum() + np.log(OUTLIER_FRACTION + (1.0 - OUTLIER_FRACTION) * density).sum())
