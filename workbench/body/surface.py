"""The implicit surface of paper D: ellipsoids on the skeleton's joints, whose fields add up to a skin.

**Field** (D eq. 2–4). Ellipsoid i has the algebraic distance d_i(X) = Σ (y/h)² over its axes, 1 on the ellipsoid, and
the field f_i = b exp(−a d_i). A part's field f is the sum over its ellipsoids and its skin is f = C. With b = C exp(a)
the skin of a part with one ellipsoid is that ellipsoid. D has an a_i and b_i for each ellipsoid; here all share them.

**Chains.** A limb is a row of two or more ellipsoids at equal spaces Δ of half length Δ √(a/π): the Gaussians
exp(−a (z/half)²) then add up to 1 within 9 % along the limb, so the skin has the radius of the ellipsoids within 2 %
(for a = 2).

**Residuals** of a point X attached to a part:
- "field": f − C (D eq. 6), dimensionless, negative outside. It says little beyond a fraction of the limb's radius.
- "distance": metres, positive outside. With ℓ = log(f / C), the part's normalised radius is r = √(1 − ℓ/a), which is
  √d for one ellipsoid; the residual is (r − 1) s outside and (r² − 1)/2 · s inside, smooth at the centre. s, metres
  per unit of r, is the mean over the part's ellipsoids by their share in f. For one ellipsoid, with y the point in
  its axes, it goes from s_near = 1/|∇√d| = √(d / Σ y²/h⁴) at the skin, which makes the residual right to first order
  (Taubin 1991), to s_far = |y|/√d, which makes its slope 1 far away, with the weight (1 − 1/√d)² of the latter.
  Inside, s_near goes over to the smallest half size at the centre, where it would depend on the direction.
  On a sphere it is exact outside. Measured against exact distances, over points outside an ellipsoid whose half sizes
  differ by a factor of 1.6 / 2.5 / 3.5 it is 0.97–1.00 / 0.88–1.02 / 0.77–1.07 of the distance. Outside the
  chains of the person it is 0.94–1.12 of it within 10 cm of the skin. Inside it is right at the skin
  and half the depth at the centre of a sphere.

**Attachment** (D eq. 5). D takes the part with the smallest |f − C|. A centimetre inside a forearm f > 2 C already, and
by that rule such a point would belong to any limb far away, whose |f − C| is C. Here the smallest |log(f / C)| decides
("field"), which outside every part is D's order and cannot underflow, or the smallest |distance| ("distance"), which
does not favour thick parts as both of these do.
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
KINDS: tuple[Kind, ...] = ("field", "distance")  # in the order of the kernel's numbers
SHARPNESS = 2.0
"""a: the larger, the less ellipsoids blend, and the narrower the band in which the field tells distances apart."""
OVERHANG = 0.3
"""Chains of ellipsoids go on beyond their limb's ends by this part of its thickness, so that joints are not thinner."""
_TOGETHER = 16  # poses at least that one thread takes


@dataclass(frozen=True, eq=False)
class Surface:
    """E ellipsoids in B parts; lengths in metres. names: E names. joints: (E,), the joint whose frame carries an
    ellipsoid. centers: (E, 3) in that frame. half_sizes: (E, 3) along the columns of `axes`, (E, 3, 3), which turn the
    ellipsoid's axes to the joint's frame. parts: (E,), the body part of each ellipsoid, 0 to B − 1, each at least once
    and in this order. part_names: B names. sharpness: a. level: C. Raises InputError when a half size, a or C is not
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
    """Find the part (K,) that each point (K, 3), m, belongs to in one pose, that of frames (1, J, ...): the first of
    those with the smallest |distance| or |log(f / C)|; raises InputError for a point that is not finite."""
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
    """Residuals (K,) of points (K, 3), m, attached to parts (K,), in one pose (P,), in the unit of their kind."""
    found = np.empty(len(points))
    surface_kernel.residuals(*_arguments(skeleton, surface, pose, points, kind, attachment, found))
    return found


def residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Compute `residuals` (K,) and their derivative (K, P) with respect to the pose, per m and rad."""
    found, jacobian = np.empty(len(points)), np.empty((len(points), len(pose)))
    surface_kernel.residual_jacobian(*_arguments(skeleton, surface, pose, points, kind, attachment, found, jacobian))
    return found, jacobian


def nearest_residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind
) -> tuple[FloatArray, FloatArray]:
    """Attach points as `attach` does in this pose and compute `residual_jacobian`; raises as both do."""
    found, jacobian = np.empty(len(points)), np.empty((len(points), len(pose)))
    arguments = _arguments(skeleton, surface, pose, _finite(points), kind, found, jacobian)
    surface_kernel.nearest_residual_jacobian(*arguments)
    return found, jacobian


def nearest_distances(skeleton: Skeleton, surface: Surface, poses: FloatArray, points: FloatArray) -> FloatArray:
    """Distances (N, K), m, of points (K, 3), m, to the parts that `attach` finds in each of the poses (N, P), on as
    many threads as numba is set to; raises as `attach` does."""
    points = np.ascontiguousarray(_finite(points), dtype=np.float64)
    found = np.empty((len(poses), len(points)))
    arguments = (
        *(np.ascontiguousarray(poses), skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(surface.table, surface.joints, surface.bounds, surface.sharpness, points, found),
    )
    parallel_for(lambda first, last: surface_kernel.nearest_distances(first, last, *arguments), len(poses), _TOGETHER)
    return found


def _finite(points: FloatArray) -> FloatArray:
    if not np.isfinite(points).all():
        raise InputError(f"surface: expected finite points, found {np.sum(~np.isfinite(points).all(axis=1))} others")
    return points


def _arguments(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, *rows: FloatArray | IntArray
) -> tuple[Any, ...]:
    """rows: an attachment, residuals (K,) and what else has a row for every point."""
    n_dofs, n = len(skeleton.dof_names), len(points)
    if pose.shape != (n_dofs,) or points.shape != (n, 3) or rows[0].shape != (n,):
        found = f"{pose.shape}, {points.shape} and {rows[0].shape}"
        raise ValueError(f"pose, points and attachment must be ({n_dofs},), (K, 3) and (K,), found {found}")
    return (
        *(np.ascontiguousarray(pose), skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(surface.table, surface.joints, surface.bounds, surface.sharpness, surface.level, KINDS.index(kind)),
        *(np.ascontiguousarray(points), *rows),
    )


def person_surface(body: Body) -> Surface:
    """Return the skin of a body, see `limbs_surface`."""
    return limbs_surface(body.limbs)


def limbs_surface(limbs: Limbs) -> Surface:
    """Return the skin of limbs: a part for each, cones as chains of ellipsoids, spheres as spheres."""
    ellipsoids = [
        (start[None], np.full((1, 3), radii[0, 0])) if sphere else _chain(start, end, radii)
        for start, end, radii, sphere in zip(limbs.starts, limbs.ends, limbs.radii, limbs.spheres, strict=True)
    ]
    sizes = [len(centers) for centers, _ in ellipsoids]
    numbered = zip(limbs.names, sizes, strict=True)
    return Surface(
        names=tuple(name if n == 1 else f"{name}_{i + 1}" for name, n in numbered for i in range(n)),
        joints=np.repeat(limbs.joints, sizes), centers=np.concatenate([centers for centers, _ in ellipsoids]),
        half_sizes=np.concatenate([half_sizes for _, half_sizes in ellipsoids]),
        axes=np.repeat(limbs.axes, sizes, axis=0), parts=np.repeat(np.arange(len(sizes)), sizes),
        part_names=limbs.names,
    )  # fmt: skip


def _chain(start: FloatArray, end: FloatArray, radii: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return centres and half sizes (n, 3) of ellipsoids along a truncated cone of radii (2, 2), as in `Limbs`, m.
    Their number makes them about as long as thick; the spaces and half lengths are those of the module's docstring."""
    length, thickness = float(np.linalg.norm(end - start)), float(radii.mean(axis=0).min())
    covered = length + 2.0 * OVERHANG * thickness
    n = max(2, round(covered / (2.0 * thickness)))
    space = covered / n
    along = ((np.arange(n) + 0.5) * space - OVERHANG * thickness) / length
    centers = start + along[:, None] * (end - start)
    across = radii[0] + along[:, None] * (radii[1] - radii[0])
    half_length = space * np.sqrt(SHARPNESS / np.pi)
    return centers, np.column_stack([across, np.full(n, half_length)])
