"""Points sampled on the visible surface: visibility, uniform density, and depth noise."""

from dataclasses import replace

import numpy as np
import pytest

from tests.oracles import rendering as oracle
from workbench.body.limbs import Limbs, person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.datasets.points import with_depth_noise
from workbench.datasets.rendering.render import Rays
from workbench.datasets.rendering.visible import first_depth, surface_points, visible_points

BODY = person(from_height(1.75))
CAMERA = plain_camera(320, 240, 200.0, (0.3, -4.0, 0.4), (0.1, 0.0, 0.2))
STANDING = np.zeros(25)
BENT = np.random.default_rng(5).uniform(*np.clip(BODY.skeleton.limits, -0.5, 0.9).T)


def body_of(starts, ends, radii, spheres):
    limbs = Limbs(
        ("limb",), np.array([0]), np.array([starts]), np.array([ends]), np.array([radii]), np.array([spheres])
    )
    return replace(BODY, limbs=limbs)


BALL = body_of((0.1, 0.0, 0.0), (0.1, 0.0, 0.0), np.full((2, 2), 0.3), True)


def reference_depth(body, pose, points):
    """Return the depths of the first hits by the reference ray caster, with one ray per point."""
    in_camera = CAMERA.to_camera(points)
    directions = (in_camera[None, :, :2] / in_camera[None, :, 2:]).astype(np.float32)
    rays = Rays(1, directions)
    return oracle.cast(body, pose, CAMERA, rays).depth[0]


@pytest.mark.parametrize("pose", [STANDING, BENT])
def test_visible_points_are_first_hits_of_their_lines_of_sight(pose):
    points = visible_points(BODY, pose, CAMERA, 300, np.random.default_rng(0))
    assert points.shape == (300, 3)
    # single-precision directions shift a ray by up to 4 m · 3e-8, and the depth of a grazing ray by up to 1 mm
    depth_errors = reference_depth(BODY, pose, points) - CAMERA.to_camera(points)[:, 2]
    assert np.abs(depth_errors).max() < 1e-3
    assert np.quantile(np.abs(depth_errors), 0.9) < 1e-6


def test_first_depths_agree_with_the_reference_ray_caster():
    rng = np.random.default_rng(1)
    points = BENT[:3] + rng.uniform(-1.0, 1.0, (500, 3))
    expected = reference_depth(BODY, BENT, points)
    assert np.isfinite(expected).any()
    assert np.isinf(expected).any()
    assert np.allclose(first_depth(BODY, BENT, CAMERA, points), expected, atol=1e-9)


def test_points_on_a_sphere_are_uniform():
    """Heights along any axis are uniform on a sphere (Archimedes); the visible cap ends at the tangent cone."""
    points = visible_points(BALL, STANDING, CAMERA, 4000, np.random.default_rng(2))
    centre, radius = np.array([0.1, 0.0, 0.0]), 0.3
    to_camera = CAMERA.position - centre
    distance = np.linalg.norm(to_camera)
    height = (points - centre) @ to_camera / distance
    assert np.allclose(np.linalg.norm(points - centre, axis=1), radius)
    min_height = radius**2 / distance
    u = (height - min_height) / (radius - min_height)
    # 99 % quantile of the Kolmogorov–Smirnov statistic: 1.63 / √n
    assert u.min() > -1e-2
    assert np.abs(np.sort(u) - (np.arange(4000) + 0.5) / 4000).max() < 1.63 / np.sqrt(4000)


def test_points_on_a_cone_are_uniform_by_area():
    cone = body_of((0.0, 0.0, -0.5), (0.0, 0.0, 0.5), np.array([[0.2, 0.2], [0.02, 0.02]]), False)
    height = visible_points(cone, STANDING, CAMERA, 3000, np.random.default_rng(6))[:, 2]
    assert len(height) == 3000
    # areas, as length times mean radius, from −0.3 to 0 and from 0 to 0.4, without the ellipsoids at the ends;
    # the visible fraction of the thick end is 2 % smaller, and 4 standard errors of the fraction are 4 %
    lower, upper = ((height > -0.3) & (height < 0.0)).sum(), ((height >= 0.0) & (height < 0.4)).sum()
    thick, thin = 0.3 * (0.164 + 0.11) / 2, 0.4 * (0.11 + 0.038) / 2
    assert lower / (lower + upper) == pytest.approx(thick / (thick + thin), abs=0.05)


def test_fractions_of_points_on_the_ends_and_the_side_are_those_of_the_areas():
    limb = body_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.9), np.array([[0.1, 0.2], [0.05, 0.15]]), False)
    x, y, z = surface_points(limb, STANDING, 60000, np.random.default_rng(3)).T
    start = np.abs((x / 0.1) ** 2 + (y / 0.2) ** 2 + (z / 0.1) ** 2 - 1.0) < 1e-9
    end = np.abs((x / 0.05) ** 2 + (y / 0.15) ** 2 + ((z - 0.9) / 0.05) ** 2 - 1.0) < 1e-9
    side = np.abs((x / (0.1 - 0.05 * z / 0.9)) ** 2 + (y / (0.2 - 0.05 * z / 0.9)) ** 2 - 1.0) < 1e-9
    assert (start | end | side).all()
    t, phi = np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 2 * np.pi, 401), indexing="ij")

    def area(x, y, z):
        """Return the area of a patch by the cross products of its grid's differences."""
        p = np.stack([x, y, z], axis=-1)
        return np.linalg.norm(np.cross(np.diff(p, axis=0)[:, :-1], np.diff(p, axis=1)[:-1]), axis=-1).sum()

    ring, level = np.sin(np.pi * t), np.cos(np.pi * t)
    areas = np.array([
        area(0.1 * ring * np.cos(phi), 0.2 * ring * np.sin(phi), 0.1 * level),
        area(0.05 * ring * np.cos(phi), 0.15 * ring * np.sin(phi), 0.05 * level),
        area((0.1 - 0.05 * t) * np.cos(phi), (0.2 - 0.05 * t) * np.sin(phi), 0.9 * t),
    ])  # fmt: skip
    fractions = np.array([on_part.mean() for on_part in (start, end, side)])
    assert np.abs(fractions - areas / areas.sum()).max() < 4 * np.sqrt(0.25 / len(x))  # 4 standard errors


def test_depth_noise_is_proportional_to_the_squared_distance():
    rng = np.random.default_rng(4)
    points = np.repeat([[0.0, 0.0, 0.0], [0.0, 4.0, 0.5]], 20000, axis=0)
    noisy = with_depth_noise(points, CAMERA, 0.02, rng)
    assert np.allclose(CAMERA.project(noisy), CAMERA.project(points), atol=1e-9)
    depth = CAMERA.to_camera(points)[:, 2]
    error = CAMERA.to_camera(noisy)[:, 2] - depth
    for half in (slice(0, 20000), slice(20000, None)):
        sigma = 0.02 * (depth[half][0] / 4.0) ** 2
        assert error[half].std() == pytest.approx(sigma, rel=4 / np.sqrt(40000))  # 4 standard errors, σ / √(2 n)
        assert error[half].mean() == pytest.approx(0.0, abs=4 * sigma / np.sqrt(20000))
