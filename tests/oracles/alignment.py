"""Surface elements, contours, backgrounds, layers and derivatives in NumPy, for `workbench.likelihoods.dense`.

S elements or K points, P degrees of freedom, images (height, width). Frames are those of one pose, (1, J, ...).
"""

from dataclasses import replace

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.cameras.camera import Camera
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
"""The minimum depth and the maximum size of a facet that is drawn."""


def project_elements(elements: SurfaceElements, frames: JointFrames, camera: Camera) -> ProjectedElements:
    """Compute the points, normals, depths and pixels of surface elements in a pose.

    Parameters
    ----------
    elements : SurfaceElements
        Points (S, 3), m, and normals (S, 3) in their joints' frames.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera.

    Returns
    -------
    ProjectedElements
        Points (S, 3), m, cosines of the angle to the line of sight (S,), depths (S,), m, and pixels (S, 2).
    """
    rotations = frames.rotations[0][elements.joints]
    points = np.einsum("sij,sj->si", rotations, elements.points) + frames.positions[0][elements.joints]
    to_camera = camera.position - points
    facing = np.einsum("sij,sj,si->s", rotations, elements.normals, to_camera) / np.linalg.norm(to_camera, axis=1)
    in_camera = camera.to_camera(points)
    return ProjectedElements(points, facing, in_camera[:, 2], camera.pixels(in_camera, 1e-6))


def visible_elements(elements: ProjectedElements, shape: tuple[int, int], min_facing: float) -> IntArray:
    """Return the elements in the image that face the camera and that no other limb occludes.

    Parameters
    ----------
    elements : ProjectedElements
        S elements in a pose.
    shape : (int, int)
        Height and width of the image, px.
    min_facing : float
        Minimum cosine of the angle to the line of sight.

    Returns
    -------
    (K,) array
        Visible elements.
    """
    within = inside(elements.pixels, shape)
    front = np.flatnonzero(within & (elements.facing > 0.0))
    nearest = np.full((shape[0] // COARSE_PX + 1, shape[1] // COARSE_PX + 1), np.inf)
    x, y = (elements.pixels[front] / COARSE_PX).astype(np.int64).T
    np.minimum.at(nearest, (y, x), elements.depth[front])
    nearest = np.asarray(cv2.erode(nearest, np.ones((3, 3), np.uint8)))
    hidden = elements.depth[front] > nearest[y, x] + THICK_M
    return front[~hidden & (elements.facing[front] > min_facing)]


def pixel_forces(camera: Camera, points: FloatArray, gradients: FloatArray) -> FloatArray:
    """Compute gradients by world points from gradients by pixels.

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
    """Compute derivatives by the pose from derivatives by points of the body.

    A rotation about a through o moves x by a × (x − o), so that a function with gradient f changes by
    a · (x × f) − f · (a × o).

    Parameters
    ----------
    motion : PointMotion
        Axes and moments (P, 3), and the pose parameters that move each joint (J, P).
    points, forces : (K, 3) arrays
        World points, m, and derivatives by them, 1/m.
    joints : (K,) array
        Joints that carry the points.

    Returns
    -------
    (K, P) array
        Derivatives by the pose, 1/m and 1/rad.
    """
    derivatives = np.cross(points, forces) @ motion.axes.T - forces @ motion.moments.T
    derivatives[:, :3] = forces
    return derivatives * motion.dof_mask[joints]


def normal(residuals: Residuals, motion: PointMotion, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Compute the normal equations of a robust loss.

    Parameters
    ----------
    residuals : Residuals
        Residuals of K points, with their gradients by the pixel.
    motion : PointMotion
        Axes and moments of the pose parameters.
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


def interpolated(smoothed_image: Float32Array, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interpolate an image bilinearly and differentiate it by central differences of one pixel.

    Parameters
    ----------
    smoothed_image : (height, width) array
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
    values = map_coordinates(smoothed_image.astype(np.float64), (rows, columns), order=1)
    centre, right, left, below, above = values.reshape(5, -1)
    return centre, 0.5 * np.column_stack([right - left, below - above])


def contour_samples(
    limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return points at distances from the outlines of limbs, at the depth of their axes.

    Parameters
    ----------
    limbs : Limbs
        L limbs; a cross-section is a circle of its mean radius.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera that sees the outlines.
    distances_px : tuple of D floats
        Distances, px.

    Returns
    -------
    (L · 2 N_CONTOUR_POINTS · D, 3) array
        Points, m; then their joints and pixels.
    """
    rotations, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", rotations, ends) + origins for ends in (limbs.starts, limbs.ends))
    edges, outwards = _edges(limbs, starts, ends, camera.position)
    metres_per_px = np.linalg.norm(edges - camera.position, axis=-1, keepdims=True) / camera.matrix[0, 0]
    points = np.concatenate([edges + distance * metres_per_px * outwards for distance in distances_px], axis=1)
    joints = np.repeat(limbs.joints, points.shape[1])
    flat = points.reshape(-1, 3)
    return flat, joints, camera.project(flat)


def _edges(limbs: Limbs, starts: FloatArray, ends: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points on the limbs' outlines.

    Parameters
    ----------
    limbs : Limbs
        L limbs.
    starts, ends : (L, 3) arrays
        Ends of their axes in the world, m.
    centre : (3,) array
        The camera's centre, m.

    Returns
    -------
    (L, 2 N_CONTOUR_POINTS, 3) array
        Points, m.
    (L, 2 N_CONTOUR_POINTS, 3) array
        Unit directions outwards.
    """
    u = ((np.arange(N_CONTOUR_POINTS) + 0.5) / N_CONTOUR_POINTS)[:, None]
    axis = starts[:, None] + (ends - starts)[:, None] * u
    side = _unit(np.cross((ends - starts)[:, None], centre - axis))
    low, high = limbs.mean_radii.T[:, :, None, None]
    radii = low + (high - low) * u
    edges, outwards = np.concatenate([axis + radii * side, axis - radii * side], axis=1), np.repeat(side, 2, axis=1)
    outwards[:, :N_CONTOUR_POINTS], outwards[:, N_CONTOUR_POINTS:] = side, -side
    spheres = limbs.spheres
    sight = _unit(centre - starts[spheres])
    across = _unit(np.cross(sight, [0.0, 0.0, 1.0]))
    angle = np.pi * np.arange(2 * N_CONTOUR_POINTS) / N_CONTOUR_POINTS
    directions = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(sight, across)[:, None]
    outwards[spheres] = directions
    edges[spheres] = starts[spheres][:, None] + limbs.radii[spheres, 0, 0][:, None, None] * directions
    return edges, outwards


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def background_log_ratio(background: BackgroundModel, image: Float32Array, epsilon: float) -> Float32Array:
    """Compute the log ratio of a person of any grey level to the background.

    Parameters
    ----------
    background : BackgroundModel
        Levels (height, width) and the numbers of frames from which they are known.
    image : (height, width) array
        Grey levels.
    epsilon : float
        Fraction of outliers.

    Returns
    -------
    (height, width) array
        Log ratios, 0 where the background is unknown.
    """
    sigma = max(background.noise, MIN_NOISE) * np.sqrt(1.0 + 1.0 / np.maximum(background.n, 1.0))
    density = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * ((image - background.level) / sigma) ** 2)
    return np.where(background.observed, -np.log(epsilon + (1.0 - epsilon) * density), 0.0).astype(np.float32)


def updated_background(background: BackgroundModel, image: Float32Array, covered: BoolArray) -> BackgroundModel:
    """Update a background from an image, except near a person and where the image differs from the background.

    Parameters
    ----------
    background : BackgroundModel
        Levels (height, width) and the numbers of frames from which they are known.
    image : (height, width) array
        Grey levels.
    covered : (height, width) array
        Pixels that the person covers.

    Returns
    -------
    BackgroundModel
        The background with the image included in its means.
    """
    near = dilated(covered, DILATION_PX)
    similar = np.abs(image - background.level) < 4.0 * max(background.noise, MIN_NOISE)
    updated = ~near & (~background.observed | (similar & (background.n < MAX_FRAMES)))
    n = background.n + updated
    return replace(background, level=background.level + updated * (image - background.level) / np.maximum(n, 1.0), n=n)


def render_layer(facets: Facets, frames: JointFrames, camera: Camera, behind: Layer) -> Layer:
    """Draw facets into a layer, pixel by pixel.

    Parameters
    ----------
    facets : Facets
        Quadrangles with V corners.
    frames : JointFrames
        The joints' frames.
    camera : Camera
        The camera.
    behind : Layer
        Elements (height, width), −1 where there is none, and their depths, m.

    Returns
    -------
    Layer
        The layer with the facets.
    """
    elements, depths = behind[0].copy(), behind[1].copy()
    rotations, origins = frames.rotations[0][facets.joints], frames.positions[0][facets.joints]
    points = camera.to_camera(np.einsum("kij,kj->ki", rotations, facets.points) + origins)
    vertices = points[facets.corners]
    y, x = np.mgrid[: elements.shape[0], : elements.shape[1]]
    for corners, cell, z in zip(camera.pixels(vertices, 1e-6), facets.elements, vertices[..., 2], strict=True):
        following = np.roll(corners, -1, axis=0)
        size = np.ptp(corners, axis=0).max()
        area = (corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1]).sum()
        if not (z.min() > NEAREST_M and area < 0.0 and size < LARGEST_PX):
            continue
        (ax, ay), (bx, by) = corners.T[:, :, None, None], following.T[:, :, None, None]
        within = ((bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0).all(axis=0) & (z.mean() < depths)
        elements[within], depths[within] = cell, z.mean()
    return elements, depths


def layer_log_ratio(layer: Layer, image: LayerImage) -> float:
    """Compute the log ratio of an image with a layer to the image with the background alone.

    Parameters
    ----------
    layer : Layer
        Elements (height, width), −1 where there is none, and their depths, m.
    image : LayerImage
        The image and what is known of the elements and of the background.

    Returns
    -------
    float
        Log ratio, summed over the pixels.
    """
    elements = layer[0]
    drawn, known = image.unoccluded & (elements >= 0), image.unoccluded & (elements >= 0) & (image.n[elements] > 0.0)
    sigma = image.sigma * np.sqrt(1.0 + 1.0 / image.n[elements[known]])
    residuals = (image.image[known] - image.texture[elements[known]]) / sigma
    density = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * residuals**2)
    return float(image.ratio[drawn].sum() + np.log(OUTLIER_FRACTION + (1.0 - OUTLIER_FRACTION) * density).sum())
