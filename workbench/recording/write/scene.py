"""Entities of a step in the world: skeletons, the solid body, particles, observed points; of a fit to points also the
flexion of hips and knees and the activity (paper D).

Styles and names are logged once, static, as pairs (entity path, archetype). The frames have positions only, as pairs
(entity path, row).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import scipy

from workbench.body.angles import flexions
from workbench.body.kinematics import JointFrames, forward, joints
from workbench.body.limbs import Body, Limbs
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface
from workbench.body.surface_mesh import surface_mesh
from workbench.core.frame import Truth
from workbench.core.step import Step
from workbench.recording.write import styles
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.utils.arrays import ByteArray, Float32Array, FloatArray, IntArray

ESTIMATE, TRUTH, PARTICLES = "world/estimate", "world/truth", "world/particles"
POINTS, FLEXION, ACTIVITY = "world/points", "flexion", "activity"
SKIN_SPACING_M = 0.036
"""Grid spacing of the recorded mesh, which takes 60 kB a frame; 25 mm is smoother and takes 130 kB."""
TRAILS = f"{ESTIMATE}/trails"
_TRAIL_EVERY = 4  # frames from one stick figure to the next
_EYE_DISTANCE_M = 2.0  # a walking person fills 80 % of the height of the view
_ELLIPSOIDS_PER_CONE = 11  # with fewer, rings are visible
_FAINTEST_LOG_WEIGHT = -6.0  # relative to the heaviest particle


@dataclass(frozen=True, eq=False)
class Figure:
    """The drawable parts of a body.

    chains: (C, longest) joints, paths that cover every bone once. half_sizes, centers: (E, 3), m, ellipsoids with axes
    (E, 3, 3), as columns, in the frames of the joints carriers (E,).
    """

    skeleton: Skeleton
    chains: IntArray
    half_sizes: FloatArray
    centers: FloatArray
    axes: FloatArray
    carriers: IntArray


def figure(body: Body) -> Figure:
    """Return the drawable parts of a body."""
    return Figure(body.skeleton, chains(body.skeleton), *_solids(body.limbs))


def fixed(drawn: Figure) -> Entities:
    """Yield the static entities: the world's axes, names of joints, colours, sizes of the solids."""
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    for path, colour, width in ((ESTIMATE, styles.ESTIMATE, 2.5), (TRUTH, styles.TRUTH, 1.75)):
        line, dot = rr.Radius.ui_points(width), rr.Radius.ui_points(width + 1.0)
        yield f"{path}/skeleton", rr.LineStrips3D.from_fields(colors=[colour], radii=line)
        names = list(drawn.skeleton.names)
        yield f"{path}/joints", rr.Points3D.from_fields(labels=names, show_labels=False, colors=[colour], radii=dot)
    solids = rr.Ellipsoids3D.from_fields(half_sizes=drawn.half_sizes, colors=[styles.BODY], fill_mode="solid")
    yield f"{ESTIMATE}/body", solids
    yield PARTICLES, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(0.15))
    yield POINTS, rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.75))


def estimate(drawn: Figure, frames: JointFrames) -> Rows:
    """Yield the expected pose, whose joints' frames are given, N = 1, as joints, skeleton and solid body."""
    yield from bones(drawn, ESTIMATE, frames.positions)
    rotations = frames.rotations[0, drawn.carriers]
    centers = frames.positions[0, drawn.carriers] + np.einsum("eij,ej->ei", rotations, drawn.centers)
    quaternions = scipy.spatial.transform.Rotation.from_matrix(rotations @ drawn.axes).as_quat()
    yield f"{ESTIMATE}/body", Row(rr.Ellipsoids3D, {"centers": centers, "quaternions": quaternions})


def skin(drawn: Figure, surface: Surface, pose: FloatArray) -> Entities:
    """Yield the expected pose's (P,) implicit surface as a mesh; raises as `surface_mesh` does."""
    vertices, triangles = surface_mesh(surface, forward(drawn.skeleton, pose[None]), SKIN_SPACING_M)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    np.add.at(normals, triangles, np.cross(b - a, c - a)[:, None])  # weighted by the triangles' areas
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    mesh = rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=triangles, vertex_normals=normals, albedo_factor=styles.SKIN
    )
    yield f"{ESTIMATE}/surface", mesh


def viewpoint(step: Step) -> FloatArray:
    """Return the horizontal vector (2,), m, from the person to the viewpoint: on the side of observed points, or else
    opposite to the first camera."""
    views, points, person = step.frame.views, step.frame.points, step.expected_pose[:2]
    if points is not None:
        points = points[np.isfinite(points).all(axis=1) & (step.attachment is None or step.attachment >= 0)]
    if points is not None and len(points):
        direction, angle = points[:, :2].mean(axis=0) - person, np.radians(-25.0)
    elif views:
        direction, angle = person - views[0].camera.position[:2], np.radians(-40.0)
    else:
        return _EYE_DISTANCE_M * np.array([1.0, -1.0]) / np.sqrt(2.0)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return _EYE_DISTANCE_M * rotation @ direction / max(float(np.linalg.norm(direction)), 1e-6)


def true_joints(skeleton: Skeleton, truth: Truth | None) -> FloatArray:
    """Return the true joints (n, J, 3), m, NaN for feet, or those of the true pose; n is 1, or 0 without truth."""
    if truth is not None and truth.joints is not None:
        n_more = len(skeleton.names) - len(truth.joints)
        return np.pad(truth.joints, ((0, n_more), (0, 0)), constant_values=np.nan)[None]
    if truth is not None and truth.pose is not None:
        return joints(skeleton, truth.pose[None])
    return np.empty((0, len(skeleton.names), 3))


def particles(drawn: Figure, positions: FloatArray, shades: ByteArray) -> Rows:
    """Yield particles' joints (n, J, 3), m, as thin skeletons with colours (n, 3)."""
    colors = np.repeat(shades, len(drawn.chains), axis=0)
    yield PARTICLES, Row(rr.LineStrips3D, {"strips": _strips(drawn, positions), "colors": colors})


def points(positions: FloatArray, attachment: IntArray | None) -> Rows:
    """Yield observed points (K, 3), m, coloured by the body part (K,) that they are attached to; grey for -1."""
    numbers = np.full(len(positions), -1) if attachment is None else attachment
    shades = np.array([*styles.PARTS, styles.NO_PART], dtype=np.uint8)
    order = np.where(numbers < 0, len(styles.PARTS), numbers % len(styles.PARTS))
    yield POINTS, Row(rr.Points3D, {"positions": positions, "colors": shades[order]})


def trails(drawn: Figure, positions: FloatArray) -> Entities:
    """Yield a motion's trails, to be logged static: some skeletons and the paths of both hands (paper C, fig. 5).

    positions: (F, J, 3), m, joints.
    """
    thin, thick = rr.Radius.ui_points(0.75), rr.Radius.ui_points(1.75)
    strips = _strips(drawn, positions[::_TRAIL_EVERY])
    yield f"{TRAILS}/figures", rr.LineStrips3D(strips, colors=[styles.TRAIL], radii=thin)
    for name, colour in (("left_wrist", styles.ESTIMATE), ("right_wrist", styles.RIGHT_HAND)):
        path = positions[:, drawn.skeleton.joint(name)].astype(np.float32)
        hand = rr.LineStrips3D([path], colors=[colour], radii=thick, labels=[name], show_labels=False)
        yield f"{TRAILS}/{name}", hand


def flexion_angles(skeleton: Skeleton, step: Step) -> dict[str, float]:
    """Return one frame's flexions, degrees, of the estimate and of a known true pose, by entity path."""
    poses, truth = {"estimate": step.expected_pose}, step.frame.truth
    if truth is not None and truth.pose is not None:
        poses["truth"] = truth.pose
    angles = {row: flexions(skeleton, pose) for row, pose in poses.items()}
    return {f"{FLEXION}/{name}/{row}": angle for row, named in angles.items() for name, angle in named.items()}


def flexion_lines(names: Sequence[str]) -> Entities:
    """Yield the styles of the curves of flexions, estimate and truth."""
    for name in names:
        for row, colour, width in (("estimate", styles.ESTIMATE, 4.0), ("truth", styles.TRUTH, 1.5)):
            yield f"{FLEXION}/{name}/{row}", styles.line(row, colour, width)


def activities(step: Step) -> Entities:
    """Yield the estimated and the true activity, as lanes of a timeline."""
    truth = step.frame.truth
    for row, activity in (("estimate", step.activity), ("truth", None if truth is None else truth.activity)):
        if activity is not None:
            yield f"{ACTIVITY}/{row}", rr.StateChange(state=activity)


def weight_colours(log_weights: FloatArray) -> ByteArray:
    """Return colours (n, 3): bright purple for the largest weight, greyish from e⁻⁶ of it down.

    The viewer draws opaque lines, so colour replaces transparency.
    """
    height = np.clip(1.0 - (log_weights - log_weights.max()) / _FAINTEST_LOG_WEIGHT, 0.0, 1.0)[:, None]
    low, high = np.array(styles.LIGHTEST_PARTICLE), np.array(styles.HEAVIEST_PARTICLE)
    return np.rint(low + height * (high - low)).astype(np.uint8)


def bones(drawn: Figure, path: str, positions: FloatArray) -> Rows:
    """Yield skeleton and joints (n, J, 3), m, of one person, or of none, which clears an earlier frame's."""
    strips = _strips(drawn, positions)
    valid = np.isfinite(strips).all(axis=(1, 2))  # true joints may be NaN
    yield f"{path}/skeleton", Row(rr.LineStrips3D, {"strips": strips[valid]})
    yield f"{path}/joints", Row(rr.Points3D, {"positions": positions.reshape(-1, 3)})


def _strips(drawn: Figure, positions: FloatArray) -> Float32Array:
    """Return joints (n, J, 3) as strips (n C, longest, 3)."""
    return positions[:, drawn.chains].reshape(-1, drawn.chains.shape[1], 3).astype(np.float32)


def chains(skeleton: Skeleton) -> IntArray:
    """Return paths from a leaf or fork up to the next fork, of equal length: short ones repeat their last joint."""
    n_children = np.bincount(skeleton.parents[skeleton.parents >= 0], minlength=len(skeleton.names))
    paths = []
    for end in np.flatnonzero((n_children != 1) & (skeleton.parents >= 0)):
        path = [end, skeleton.parents[end]]
        while n_children[path[-1]] == 1 and skeleton.parents[path[-1]] >= 0:
            path.append(skeleton.parents[path[-1]])
        paths.append(path[::-1])
    longest = max(map(len, paths))
    return np.array([path + path[-1:] * (longest - len(path)) for path in paths])


def _solids(limbs: Limbs) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return half sizes (E, 3), centres (E, 3), axes (E, 3, 3) and joints (E,) of the ellipsoids that draw the limbs.

    Rerun has no truncated cones with elliptical sections. Each cone is a row of ellipsoids with the cone's section at
    their centres, dense near the ends, which rounds the ends too.
    """
    half_sizes, centers, counts = [], [], [1 if sphere else _ELLIPSOIDS_PER_CONE for sphere in limbs.spheres]
    for i, n in enumerate(counts):
        u = (1.0 - np.cos(np.linspace(0.0, np.pi, n)))[:, None] / 2.0
        axis, length, (first, last) = limbs.ends[i] - limbs.starts[i], limbs.lengths[i], limbs.radii[i]
        reach = np.minimum(u * length + first.min(), (1.0 - u) * length + last.min())
        half_sizes.append(np.hstack([first + u * (last - first), reach]))
        centers.append(limbs.starts[i] + u * axis)
    limb = np.repeat(np.arange(len(limbs)), counts)
    return np.concatenate(half_sizes), np.concatenate(centers), limbs.axes[limb], limbs.joints[limb]
