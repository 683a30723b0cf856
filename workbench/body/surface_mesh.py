"""The implicit surface as triangles, for a recording; nothing is computed from them."""

import importlib

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.kinematics import JointFrames
from workbench.body.surface import Surface
from workbench.body.surface_reference import log_fields
from workbench.errors import InputError


def surface_mesh(surface: Surface, frames: JointFrames, spacing_m: float = 0.015) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3), m, and triangles (T, 3), seen counter-clockwise from outside, of the skin in one pose.

    frames: of one pose, (1, J, ...). The skin of all parts together: what is inside any part is inside. By marching
    cubes on a grid of `spacing_m` (Lewiner et al. 2003, as scikit-image has it), about a second for a person at 15 mm.

    Raises InputError when scikit-image, the optional extra "mesh", is not installed.
    """
    try:
        measure = importlib.import_module("skimage.measure")
    except ImportError:
        raise InputError(
            "the mesh of a surface needs scikit-image: install the extra, pip install 'workbench[mesh]'"
        ) from None
    low, high = _box(surface, frames)
    low = low - 2.0 * spacing_m
    size = np.ceil((high - low) / spacing_m).astype(int) + 3
    fields = np.empty(size)
    for i in range(size[0]):  # a slice at a time: the fields of all parts need room
        grid = np.stack(np.meshgrid(i, np.arange(size[1]), np.arange(size[2]), indexing="ij"), axis=-1)
        points = low + spacing_m * grid.reshape(-1, 3)
        fields[i] = log_fields(surface, frames, points).max(axis=1).reshape(size[1:])
    vertices, triangles, _, _ = measure.marching_cubes(
        fields, 0.0, spacing=(spacing_m,) * 3, gradient_direction="ascent"
    )
    return low + vertices.astype(np.float64), triangles.astype(np.int64)


def _box(surface: Surface, frames: JointFrames) -> tuple[FloatArray, FloatArray]:
    """Corners (3,) and (3,), m, of a box around the skin: where n ellipsoids overlap, d is at most 1 + log n / a."""
    rotations, positions = frames.rotations[0, surface.joints], frames.positions[0, surface.joints]
    centers = positions + np.einsum("eab,eb->ea", rotations, surface.centers)
    most = np.bincount(surface.parts).max()
    stretch = np.sqrt(1.0 + np.log(most) / surface.sharpness)
    reach = stretch * np.linalg.norm((rotations @ surface.axes) * surface.half_sizes[:, None], axis=2)
    return (centers - reach).min(axis=0), (centers + reach).max(axis=0)
