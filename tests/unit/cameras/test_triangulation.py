"""Triangulation against closed forms and independent least squares, with distorted pixels of several cameras."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observed_walkers import camera_arc

from workbench.cameras.camera import plain_camera
from workbench.cameras.triangulation import ray_distances, triangulate, triangulate_normalized

LENS = np.array([-0.1, 0.02, 0.001, -0.001, 0.0])


def cameras(n):
    """Return n cameras around the world's origin, with distortion."""
    return [replace(camera, distortion=LENS) for camera in camera_arc(n)]


def noisy_pixels(rig, seed, shape=(4, 5)):
    """Return pixels (V, *shape, 2) of random points, 5 px off, so that rays do not meet."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(*shape, 3)) * 0.4 + [0.0, 0.0, 1.0]
    return np.stack([camera.project(points) + rng.normal(size=(*shape, 2)) * 5.0 for camera in rig])


def rays(rig, pixels):
    return np.stack([camera.directions(camera.undistorted(one)) for camera, one in zip(rig, pixels, strict=True)])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_two_rays_give_the_middle_of_their_shortest_connection(seed):
    rig = cameras(2)
    pixels = noisy_pixels(rig, seed)
    (a, b), (p, q) = rays(rig, pixels), (camera.position for camera in rig)
    cosine, to_a, to_b = (a * b).sum(axis=-1), a @ (q - p), b @ (q - p)
    s, t = (to_a - cosine * to_b) / (1.0 - cosine**2), (cosine * to_a - to_b) / (1.0 - cosine**2)
    nearest_a, nearest_b = p + s[..., None] * a, q + t[..., None] * b
    points = triangulate(rig, pixels)
    np.testing.assert_allclose(points, 0.5 * (nearest_a + nearest_b), atol=1e-9)
    gaps = np.linalg.norm(nearest_a - nearest_b, axis=-1)
    np.testing.assert_allclose(ray_distances(a, b, q - p), gaps, atol=1e-9)
    assert gaps.max() > 1e-3


@pytest.mark.parametrize("n", [2, 3, 5])
def test_points_minimize_the_distances_to_any_number_of_rays(n):
    rig = cameras(n)
    pixels = noisy_pixels(rig, n, shape=(6,))
    pixels[0, 0] = np.nan
    across = np.eye(3) - np.einsum("vji,vjk->vjik", *2 * [rays(rig, pixels)])
    for j, point in enumerate(triangulate(rig, pixels)):
        seen = np.flatnonzero(np.isfinite(pixels[:, j, 0]))
        if len(seen) < 2:
            assert np.isnan(point).all()
            continue
        system = np.concatenate([across[v, j] for v in seen])
        target = np.concatenate([across[v, j] @ rig[v].position for v in seen])
        np.testing.assert_allclose(point, np.linalg.lstsq(system, target, rcond=None)[0], atol=1e-9)


def test_parallel_rays_and_single_rays_have_no_point():
    rig = [plain_camera(100, 100, 90.0, (0.0, y, 1.0), (9.0, y, 1.0)) for y in (0.0, 1.0)]
    assert np.isnan(triangulate_normalized(rig, np.zeros((2, 1, 2)))).all()
    assert np.isnan(triangulate(rig[:1], np.full((1, 3, 2), 20.0))).all()
    assert np.isfinite(triangulate_normalized(rig, np.array([[[-0.1, 0.0]], [[0.1, 0.0]]]))).all()
