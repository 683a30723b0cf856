"""Bodies, poses and points for the tests of the surface."""

import numpy as np

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.body.surface import Surface, person_surface

BODY = person(from_height(1.75))
PERSON = (BODY.skeleton, person_surface(BODY))


def tree(seed, n_joints=20):
    """Return a random skeleton: random bones and axes, with zero to three degrees of freedom per joint."""
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(rng.integers(max(0, j - 4), j) for j in range(1, n_joints))])
    n_rotations = rng.integers(0, 4, n_joints)
    n_rotations[0] = 3
    axes = rng.standard_normal((n_rotations.sum(), 3))
    axes = np.concatenate([np.eye(3), axes / np.linalg.norm(axes, axis=1, keepdims=True)])
    offsets = rng.standard_normal((n_joints, 3))
    offsets *= rng.uniform(0.1, 0.4, (n_joints, 1)) / np.linalg.norm(offsets, axis=1, keepdims=True)
    offsets[0] = 0.0
    return Skeleton(
        names=tuple(f"joint_{j}" for j in range(n_joints)),
        parents=parents,
        offsets=offsets,
        dof_names=tuple(f"dof_{p}" for p in range(len(axes))),
        dof_joints=np.concatenate([[0, 0, 0], np.repeat(np.arange(n_joints), n_rotations)]),
        dof_axes=axes,
        limits=np.tile([-1e6, 1e6], (len(axes), 1)),
    )


def blended(seed, skeleton, n_parts=5):
    """Return a surface whose parts have one to four ellipsoids of random orientation on random joints."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 5, n_parts)
    n = int(sizes.sum())
    axes, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    return Surface(
        names=tuple(f"ellipsoid_{i}" for i in range(n)),
        joints=rng.integers(0, len(skeleton.names), n),
        centers=0.1 * rng.standard_normal((n, 3)),
        half_sizes=rng.uniform(0.04, 0.2, (n, 3)),
        axes=axes * np.sign(np.linalg.det(axes))[:, None, None],
        parts=np.repeat(np.arange(n_parts), sizes),
        part_names=tuple(f"part_{b}" for b in range(n_parts)),
        sharpness=1.3,
        level=0.7,
    )


def lone(half_sizes=(0.05, 0.05, 0.05), **options):
    """Return a skeleton with one joint and a surface of one ellipsoid on it."""
    skeleton = Skeleton(
        names=("root",),
        parents=np.array([-1]),
        offsets=np.zeros((1, 3)),
        dof_names=BODY.skeleton.dof_names[:N_ROOT],
        dof_joints=np.zeros(N_ROOT, dtype=np.int64),
        dof_axes=BODY.skeleton.dof_axes[:N_ROOT],
        limits=BODY.skeleton.limits[:N_ROOT],
    )
    surface = Surface(
        names=("ellipsoid",),
        joints=np.zeros(1, dtype=np.int64),
        centers=np.zeros((1, 3)),
        half_sizes=np.array([half_sizes]),
        axes=np.eye(3)[None],
        parts=np.zeros(1, dtype=np.int64),
        part_names=("part",),
        **options,
    )
    return skeleton, surface


def pose_and_points(rng, skeleton, surface, n, spread=0.06):
    """Return a random pose, its frames, and points inside, on and decimetres outside the ellipsoids."""
    pose = np.concatenate([rng.normal(0.0, 2.0, 3), rng.normal(0.0, 0.7, len(skeleton.dof_names) - 3)])
    frames = forward_oracle(skeleton, pose[None])
    ellipsoids = rng.integers(len(surface), size=n)
    joints = surface.joints[ellipsoids]
    centers = np.einsum("kab,kb->ka", frames.rotations[0, joints], surface.centers[ellipsoids])
    points = frames.positions[0, joints] + centers + spread * rng.standard_normal((n, 3)) * rng.uniform(0, 3, (n, 1))
    return pose, frames, points
