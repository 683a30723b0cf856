"""Paper A's image-motion likelihood of one camera in plain NumPy, float64, for `workbench.likelihoods.image_motion`.

It follows the paper's equations of the planar patch and of the limb likelihood. N particles, L limbs, n sample points
(u, v) per limb, u = 0..1 along its patch and v = −1..1 across it. A model has the constants of A eq. 10 and 11.
"""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.cameras.camera import Camera
from workbench.likelihoods.cues.image_levels import bilinear
from workbench.likelihoods.image_motion.kernel import LimbModel, Occlusion
from workbench.likelihoods.image_motion.patches import MIN_AREA, MIN_DEPTH, MIN_SINE
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class PosedView:
    """A camera's smoothed grey levels (height, width), and the joints' frames in N poses of the body at that time."""

    camera: Camera
    image: Float32Array
    frames: JointFrames


@dataclass(frozen=True, eq=False)
class Patches:
    """The limbs' planar patches as one camera sees them.

    corners : (N, L, 2, 2, 2), px, [u = 0 or 1, v = −1 or 1, (x, y)]: at the limb's start or end, at the left or right
        edge of a limb that points up.
    depths : (N, L, 2), of the patch's axis at its start and end, m.
    cos_alpha : (N, L), 1 for spheres, 0 where a limb has no patch.
    """

    corners: FloatArray
    depths: FloatArray
    cos_alpha: FloatArray

    def positions(self, samples: FloatArray) -> FloatArray:
        """Return pixels (N, L, n, 2) of points (n, 2) of the patch, u = 0..1 along the limb and v = −1..1 across it."""
        u, v = samples[:, 0], samples[:, 1]
        weights = np.stack([1.0 - u, u])[:, None] * np.stack([1.0 - v, 1.0 + v])[None] / 2.0  # (2, 2, n)
        return np.einsum("nlabx,abi->nlix", self.corners, weights)

    def sample_depths(self, samples: FloatArray) -> FloatArray:
        """Return depths (N, L, n), m, of the same points, equal across a limb because its patch faces the camera."""
        return self.depths[..., :1] + samples[:, 0] * np.diff(self.depths)


def view_log_prob(
    limbs: Limbs, samples: FloatArray, model: LimbModel, before: PosedView, now: PosedView
) -> tuple[FloatArray, IntArray]:
    """Return log p(I_t | φ_t, φ_t−1, I_t−1), (N,), and the numbers (N,) of points outside the images."""
    patches_before, patches_now = limb_patches(limbs, before), limb_patches(limbs, now)
    points_before, points_now = patches_before.positions(samples), patches_now.positions(samples)
    cos_alpha = np.where(patches_before.cos_alpha > 0.0, patches_now.cos_alpha, 0.0)
    inside = inside_image(before.image, points_before) & inside_image(now.image, points_now)
    inside &= (cos_alpha > 0)[..., None]
    compared = inside & ~hidden_samples(limbs, patches_now, samples, model.occlusion)
    n_compared = compared.sum(axis=-1)
    residuals = bilinear(now.image, points_now) - bilinear(before.image, points_before)
    compared_fraction = n_compared / len(samples)
    log_p = _limb_log_prob(_exponent(residuals, compared, model), cos_alpha, cos_alpha * compared_fraction, model)
    if model.background == "static":
        changes = bilinear(now.image, points_now) - bilinear(before.image, points_now)
        changes = np.where(inside_image(before.image, points_now), changes, 0.0)
        log_p -= compared_fraction * _static_log_ratio(_exponent(changes, compared, model), model)
    return log_p.sum(axis=-1), (~inside).sum(axis=(-1, -2))


def _exponent(residuals: FloatArray, compared: BoolArray, model: LimbModel) -> FloatArray:
    """Return k times the sum or the mean, (N, L), of the squared residuals (N, L, n) of the points compared."""
    exponent: FloatArray = model.effective_pixels * (np.where(compared, residuals, 0.0) ** 2).sum(axis=-1)
    return exponent / np.maximum(compared.sum(axis=-1), 1) if model.reduction == "mean" else exponent


def _static_log_ratio(exponent: FloatArray, model: LimbModel) -> FloatArray:
    """Return log p of points on a static background minus log p of points where nothing changed, (N, L), at most 0.

    exponent : weighted sums (N, L) of squared changes, grey levels².
    """
    peak = np.log((1.0 - model.outlier_fraction) / (np.sqrt(2.0 * np.pi) * model.sigma))
    with np.errstate(divide="ignore"):
        flat = np.log(model.outlier_fraction / 256.0)
    return np.logaddexp(peak - exponent / (2.0 * model.sigma**2), flat) - np.logaddexp(peak, flat)


def _limb_log_prob(exponent: FloatArray, cos_alpha: FloatArray, visible: FloatArray, model: LimbModel) -> FloatArray:
    """Return log p_j of A eq. 10 and 11, (N, L).

    exponent : weighted sums (N, L) of squared residuals, grey levels².
    visible : the fraction q (N, L) of each limb that is compared, times cos α.
    """
    q = np.asarray(visible)
    with np.errstate(divide="ignore"):
        sigma = model.sigma / np.where(q > 0.0, cos_alpha, 1.0)
        gaussian = np.log(q * (1.0 - model.outlier_fraction) / (np.sqrt(2.0 * np.pi) * sigma)) - exponent / (
            2.0 * sigma**2
        )
        flat = np.log(q * model.outlier_fraction / 256.0 + (1.0 - q) * model.p_occluded)
    return np.logaddexp(gaussian, flat)


def limb_patches(limbs: Limbs, view: PosedView) -> Patches:
    """Return the planar patch of every limb, which contains the limb's axis and faces the camera (A, fig. 2).

    A limb's edges lie at the half width of its section seen from the camera. A sphere's patch is the square inscribed
    in its outline, upright along the joint frame's z axis, so that its four corners lie on the outline.
    """
    rotation = view.camera.rotation @ view.frames.rotations[:, limbs.joints]  # limb to camera
    origin = view.camera.to_camera(view.frames.positions[:, limbs.joints])
    start = origin + np.einsum("nlab,lb->nla", rotation, limbs.starts)
    end = origin + np.einsum("nlab,lb->nla", rotation, limbs.ends)
    axis = _unit(np.where(limbs.spheres[:, None], rotation[..., 2], end - start))
    line_of_sight = _unit((start + end) / 2.0)
    across = np.cross(line_of_sight, axis)
    sine = np.linalg.norm(across, axis=-1)
    across = _unit(across)

    section = np.einsum("nlab,nla->nlb", rotation, across)[..., :2]
    half_width = np.linalg.norm(limbs.radii * section[:, :, None], axis=-1)  # (N, L, 2)
    upright = np.cross(across, line_of_sight)
    half_side = np.where(limbs.spheres, limbs.radii[:, 0, 0], 0.0)[:, None] / np.sqrt(2.0)
    half_width = np.where(limbs.spheres[:, None], half_side, half_width)
    ends = np.stack([start - half_side * upright, end + half_side * upright], axis=2)  # (N, L, 2, 3)
    sides = half_width[..., None] * across[:, :, None]
    corners = np.stack([ends - sides, ends + sides], axis=3)  # (N, L, 2, 2, 3), in the camera's frame

    cos_alpha = np.where(limbs.spheres, 1.0, np.linalg.norm(axis[..., :2], axis=-1))
    usable = (corners[..., 2] > MIN_DEPTH).all(axis=(2, 3)) & (sine > MIN_SINE)
    return Patches(view.camera.pixels(corners, MIN_DEPTH), ends[..., 2], np.where(usable, cos_alpha, 0.0))


def hidden_samples(limbs: Limbs, patches: Patches, samples: FloatArray, occlusion: Occlusion) -> BoolArray:
    """Return which points (N, L, n) other limbs occlude.

    "sample": a point is occluded by a patch (a disc for a sphere) that covers it and whose axis is nearer by more than
    half the sum of the two limbs' mean radii. This is half the distance between the axes of two touching limbs, because
    limbs that overlap at a joint must not occlude each other. "limb" (A, section 5): all points of a limb are occluded
    if any of them is covered by a limb that does not continue it and whose nearest surface is nearer than its own.
    "none": nothing is occluded.
    """
    points, depths = patches.positions(samples), patches.sample_depths(samples)
    hidden = np.zeros(points.shape[:-1], dtype=bool)
    if occlusion == "none":
        return hidden
    thickness = limbs.radii.mean(axis=(1, 2))
    nearest = patches.depths.min(axis=-1) - thickness
    for k in range(len(limbs)):
        for j in range(len(limbs)):
            if j == k:
                continue
            covered, depth = cover(patches, k, bool(limbs.spheres[k]), points[:, j])
            if occlusion == "sample":
                hidden[:, j] |= covered & (depth + (thickness[j] + thickness[k]) / 2.0 < depths[:, j])
            elif not limbs.connected[j, k]:
                behind = nearest[:, k] < nearest[:, j]
                hidden[:, j] |= (covered & behind[:, None]).any(axis=1)[:, None]
    return hidden


def cover(patches: Patches, k: int, sphere: bool, points: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return which pixels (N, n, 2) limb k covers, (N, n), and the depths of its axis there, (N, n), m."""
    corners = patches.corners[:, k]
    start, end = corners[:, 0].mean(axis=1), corners[:, 1].mean(axis=1)
    edges = (corners[:, :, 1] - corners[:, :, 0]) / 2.0  # (N, 2, 2): half the patch's width at its start and end
    along, across = end - start, edges.mean(axis=1)
    area = _cross(along, across)
    usable = (patches.cos_alpha[:, k] > 0.0) & (np.abs(area) > MIN_AREA)
    safe_area = np.where(usable, area, 1.0)[:, None]
    offset = points - start[:, None]
    u = _cross(offset, across[:, None]) / safe_area
    v = _cross(along[:, None], offset) / safe_area
    if sphere:
        covered = (2.0 * u - 1.0) ** 2 + v**2 <= 2.0  # the circle through the four corners
    else:
        widths = np.linalg.norm(edges, axis=-1) / np.maximum(np.linalg.norm(across, axis=-1), 1e-12)[:, None]
        covered = (u >= 0.0) & (u <= 1.0) & (np.abs(v) <= widths[:, :1] + u * np.diff(widths))
    depth = patches.depths[:, k, :1] + u * np.diff(patches.depths[:, k])
    if sphere:
        depth = np.broadcast_to(patches.depths[:, k].mean(axis=-1, keepdims=True), u.shape)
    return covered & usable[:, None], depth


def inside_image(image: Float32Array, points: FloatArray) -> BoolArray:
    """Return whether points (..., 2), px, lie between the centres of an image's pixels; NaN does not."""
    height, width = image.shape
    x, y = points[..., 0], points[..., 1]
    return (x >= 0.0) & (x < width - 1) & (y >= 0.0) & (y < height - 1)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
