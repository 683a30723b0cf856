"""The implicit surface of paper D: ellipsoids on the skeleton's joints, whose fields add up to a skin.

**Field** (D eq. 2–4). Ellipsoid i has the algebraic distance d_i(X) = Σ (y/h)² over its axes, 1 on the ellipsoid, and
the field f_i = b exp(−a d_i). A part's field f is the sum over its ellipsoids and its skin is f = C. With b = C exp(a)
the skin of a part with one ellipsoid is that ellipsoid. D has an a_i and b_i for each ellipsoid; here all share them.

**Chains.** A limb is a row of two or more ellipsoids at equal spaces Δ of half length Δ √(a/π): the Gaussians
exp(−a (z/half)²) then add up to 1 within 9 % along the limb, so the skin has the radius of the ellipsoids within 2 %
(for a = 2; 9 % for a = 0.5).

**Residuals** of a point X attached to a part:
- "field": f − C (D eq. 6), dimensionless, negative outside. It saturates beyond a fraction of the limb's radius.
- "distance": metres, positive outside. With ℓ = log(f / C), the part's normalised radius is r = √(1 − ℓ/a), which is
  √d for one ellipsoid; the residual is (r − 1) s outside and (r² − 1)/2 · s inside, smooth at the centre. s, metres
  per unit of r, is the mean over the part's ellipsoids weighted by their fields. For one ellipsoid, with y the point
  in its axes, s varies from s_near = 1/|∇√d| = √(d / Σ y²/h⁴) at the skin, where the residual is then correct to first
  order (Taubin 1991), to s_far = |y|/√d, with the correct slope far away; the weight of s_far is (1 − 1/√d)².
  Inside, s_near tends to the smallest half size at the centre, where it would depend on the direction.
  On a sphere it is exact outside. Outside an ellipsoid whose half sizes differ by a factor of 1.6 / 2.5 / 3.5 it is
  0.97–1.00 / 0.88–1.02 / 0.77–1.07 of the exact distance. Outside the chains of the person it is 0.94–1.12 of it within
  10 cm of the skin. Inside it is exact at the skin and half the depth at the centre of a sphere.

**Attachment** (D eq. 5). D chooses the part with the smallest |f − C|. One centimetre inside a forearm f > 2 C already,
so that by this rule such a point belongs to a distant limb, whose |f − C| is C. Here the smallest |log(f / C)| decides
("field"), which outside every part has D's order and cannot underflow, or the smallest |distance| ("distance"), which,
unlike both of these, does not favour thick parts.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from workbench.body import surface_kernel
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Body, Limbs
from workbench.body.skeleton import Skeleton
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.parallel import parallel_for

Kind = Literal["field", "distance"]
KINDS: tuple[Kind, ...] = ("field", "distance")  # in the order of the kernel's codes
SHARPNESS = 2.0
"""a: larger values blend ellipsoids less, and narrow the band in which the field discriminates distances. Paper D gives
no value; distances depend little on it."""
OVERHANG = 0.3
"""Extension of chains of ellipsoids beyond their limb's ends, as a fraction of its thickness, so that joints are not
thinner."""
_MIN_POSES = 16  # minimum poses per thread


@dataclass(frozen=True, eq=False)
class Surface:
    """E ellipsoids in B parts; lengths in metres. names: E names. joints: (E,), whose frames carry the ellipsoids.
    centers: (E, 3) in that frame. half_sizes: (E, 3) along the columns of `axes`, (E, 3, 3), which rotate the
    ellipsoid's axes to the joint's frame. parts: (E,), the body part of each ellipsoid, 0 to B − 1, each at least once
    and in this order. part_names: B names. sharpness: a. level: C. Raises InputError if a half size, a or C is not
    positive, or the parts are not in order."""

    names: tuple[str, ...]
    joints: IntArray
    centers: FloatArray
    half_sizes: FloatArray
    axes: FloatArray
    parts: IntArray
    part_names: tuple[str, ...]
    sharpness: float = SHARPNESS
    level: float = 1.0

    def __post_init__(self) -> None:
        if not (np.all(self.half_sizes > 0.0) and self.sharpness > 0.0 and self.level > 0.0):
            raise InputError("surface: expected positive half sizes, sharpness and level")
        steps = np.diff(self.parts, prepend=-1, append=len(self.part_names))
        if not len(self.names) or np.any((steps != 0) & (steps != 1)) or steps[-1] != 1:
            raise InputError("surface: expected the ellipsoids part by part, and at least one in every part")

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def table(self) -> FloatArray:
        """The kernel's table (E, 19): centre, the axes over the half sizes as rows, 1 / half size² and half size² along
        each, and the largest 1 / half size²."""
        square = self.half_sizes**2
        rows = (self.axes / self.half_sizes[:, None]).swapaxes(1, 2).reshape(-1, 9)
        return np.column_stack([self.centers, rows, 1.0 / square, square, 1.0 / square.min(axis=1)])

    @cached_property
    def bounds(self) -> IntArray:
        """(B + 1,): part b has the ellipsoids bounds[b] to bounds[b + 1] − 1."""
        return np.searchsorted(self.parts, np.arange(len(self.part_names) + 1))


def attach(surface: Surface, frames: JointFrames, points: FloatArray, kind: Kind = "distance") -> IntArray:
    """Return the part (K,) of each point (K, 3), m, in one pose, that of frames (1, J, ...): the first with the
    smallest |distance| or |log(f / C)|; raises InputError for a point that is not finite."""
    points = np.ascontiguousarray(_finite(points), dtype=np.float64)
    attachment = np.empty(len(points), dtype=np.int64)
    surface_kernel.attach(
        *(surface.table, surface.joints, surface.bounds, surface.sharpness, KINDS.index(kind)),
        *(frames.rotations[0], frames.positions[0], points, attachment),
    )
    return attachment


def residuals(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> FloatArray:
    """Return residuals (K,), in their kind's unit, of points (K, 3), m, attached to parts (K,), in one pose (P,)."""
    values = np.empty(len(points))
    surface_kernel.residuals(*_arguments(skeleton, surface, pose, points, kind, attachment, values))
    return values


def residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return `residuals` (K,) and their derivatives (K, P) with respect to the pose, per m and rad."""
    values, jacobian = np.empty(len(points)), np.empty((len(points), len(pose)))
    surface_kernel.residual_jacobian(*_arguments(skeleton, surface, pose, points, kind, attachment, values, jacobian))
    return values, jacobian


def nearest_residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind
) -> tuple[FloatArray, FloatArray]:
    """Attach points as `attach` in this pose and return `residual_jacobian`; raises as both."""
    values, jacobian = np.empty(len(points)), np.empty((len(points), len(pose)))
    arguments = _arguments(skeleton, surface, pose, _finite(points), kind, values, jacobian)
    surface_kernel.nearest_residual_jacobian(*arguments)
    return values, jacobian


def nearest_distances(skeleton: Skeleton, surface: Surface, poses: FloatArray, points: FloatArray) -> FloatArray:
    """Return distances (N, K), m, of points (K, 3), m, to the parts of `attach` in each of the poses (N, P), on numba's
    number of threads; raises as `attach`."""
    points = np.ascontiguousarray(_finite(points), dtype=np.float64)
    distances = np.empty((len(poses), len(points)))
    arguments = (
        *(np.ascontiguousarray(poses), skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(surface.table, surface.joints, surface.bounds, surface.sharpness, points, distances),
    )
    parallel_for(lambda first, last: surface_kernel.nearest_distances(first, last, *arguments), len(poses), _MIN_POSES)
    return distances


def _finite(points: FloatArray) -> FloatArray:
    if not np.isfinite(points).all():
        raise InputError(
            f"surface: expected finite points, found {np.sum(~np.isfinite(points).all(axis=1))} non-finite ones"
        )
    return points


def _arguments(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, *rows: FloatArray | IntArray
) -> tuple[Any, ...]:
    """Return the kernel's arguments; rows: an attachment, residuals (K,) and other arrays with a row per point."""
    n_dofs, n = len(skeleton.dof_names), len(points)
    if pose.shape != (n_dofs,) or points.shape != (n, 3) or rows[0].shape != (n,):
        shapes = f"{pose.shape}, {points.shape} and {rows[0].shape}"
        raise ValueError(f"pose, points and attachment must be ({n_dofs},), (K, 3) and (K,), found {shapes}")
    return (
        *(np.ascontiguousarray(pose), skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(surface.table, surface.joints, surface.bounds, surface.sharpness, surface.level, KINDS.index(kind)),
        *(np.ascontiguousarray(points), *rows),
    )


def person_surface(body: Body, sharpness: float = SHARPNESS) -> Surface:
    """Return the skin of a body, see `limbs_surface`."""
    return limbs_surface(body.limbs, sharpness)


def limbs_surface(limbs: Limbs, sharpness: float = SHARPNESS) -> Surface:
    """Return the skin of limbs: a part for each limb; cones are chains of ellipsoids. sharpness: a."""
    ellipsoids = [
        (start[None], np.full((1, 3), radii[0, 0])) if sphere else _chain(start, end, radii, sharpness)
        for start, end, radii, sphere in zip(limbs.starts, limbs.ends, limbs.radii, limbs.spheres, strict=True)
    ]
    sizes = [len(centers) for centers, _ in ellipsoids]
    named_sizes = zip(limbs.names, sizes, strict=True)
    return Surface(
        names=tuple(name if n == 1 else f"{name}_{i + 1}" for name, n in named_sizes for i in range(n)),
        joints=np.repeat(limbs.joints, sizes), centers=np.concatenate([centers for centers, _ in ellipsoids]),
        half_sizes=np.concatenate([half_sizes for _, half_sizes in ellipsoids]),
        axes=np.repeat(limbs.axes, sizes, axis=0), parts=np.repeat(np.arange(len(sizes)), sizes),
        part_names=limbs.names, sharpness=sharpness,
    )  # fmt: skip


def _chain(start: FloatArray, end: FloatArray, radii: FloatArray, sharpness: float) -> tuple[FloatArray, FloatArray]:
    """Return centres and half sizes (n, 3) of ellipsoids along a truncated cone of radii (2, 2), as in `Limbs`, m. They
    are about as long as thick; the module's docstring defines their spacing and half lengths."""
    length, thickness = float(np.linalg.norm(end - start)), float(radii.mean(axis=0).min())
    covered = length + 2.0 * OVERHANG * thickness
    n = max(2, round(covered / (2.0 * thickness)))
    spacing = covered / n
    along = ((np.arange(n) + 0.5) * spacing - OVERHANG * thickness) / length
    centers = start + along[:, None] * (end - start)
    across = radii[0] + along[:, None] * (radii[1] - radii[0])
    half_length = spacing * np.sqrt(sharpness / np.pi)
    return centers, np.column_stack([across, np.full(n, half_length)])
