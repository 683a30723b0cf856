"""Points drawn from what a camera sees: on the surface, visible, evenly spread; errors along the line of sight."""

from dataclasses import replace

import numpy as np
import pytest

from tests.oracles import rendering as oracle
from workbench.body.camera import plain_camera
from workbench.body.limbs import Limbs, person
from workbench.body.shape import from_height
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
    """First hits by the plain NumPy ray caster, one ray a point."""
    seen = CAMERA.to_camera(points)
    directions = (seen[None, :, :2] / seen[None, :, 2:]).astype(np.float32)
    rays = Rays(1, directions)
    return oracle.cast(body, pose, CAMERA, rays).depth[0]


@pytest.mark.parametrize("pose", [STANDING, BENT])
def test_visible_points_are_the_first_that_their_lines_of_sight_meet(pose):
    points = visible_points(BODY, pose, CAMERA, 300, np.random.default_rng(0))
    assert points.shape == (300, 3)
    # single-precision directions move a ray by up to 4 m · 3e-8, a grazing one's depth by up to the millimetre allowed
    apart = reference_depth(BODY, pose, points) - CAMERA.to_camera(points)[:, 2]
    assert np.abs(apart).max() < 1e-3
    assert np.quantile(np.abs(apart), 0.9) < 1e-6


def test_the_depth_along_single_lines_of_sight_is_that_of_the_reference_caster():
    rng = np.random.default_rng(1)
    points = BENT[:3] + rng.uniform(-1.0, 1.0, (500, 3))
    expected = reference_depth(BODY, BENT, points)
    assert np.isfinite(expected).any()
    assert np.isinf(expected).any()
    assert np.allclose(first_depth(BODY, BENT, CAMERA, points), expected, atol=1e-9)


def test_a_ball_is_covered_evenly():
    """Archimedes: on a sphere, heights along any axis are even; the seen cap ends where the lines of sight touch."""
    points = visible_points(BALL, STANDING, CAMERA, 4000, np.random.default_rng(2))
    centre, radius = np.array([0.1, 0.0, 0.0]), 0.3
    towards = CAMERA.position - centre
    distance = np.linalg.norm(towards)
    height = (points - centre) @ towards / distance
    assert np.allclose(np.linalg.norm(points - centre, axis=1), radius)
    lowest = radius**2 / distance
    u = (height - lowest) / (radius - lowest)
    # the Kolmogorov distance to the even distribution stays below 1.63 / √n in 99 of 100 draws
    assert u.min() > -1e-2
    assert np.abs(np.sort(u) - (np.arange(4000) + 0.5) / 4000).max() < 1.63 / np.sqrt(4000)


def test_a_tapering_limb_is_covered_by_area():
    spike = body_of((0.0, 0.0, -0.5), (0.0, 0.0, 0.5), np.array([[0.2, 0.2], [0.02, 0.02]]), False)
    height = visible_points(spike, STANDING, CAMERA, 3000, np.random.default_rng(6))[:, 2]
    assert len(height) == 3000
    # clear of the ellipsoids at the ends, from −0.3 to 0 and from 0 to 0.4, by area as length times mean radius;
    # 2 % less is seen of the thick end, whose edges are further round, and 4 standard errors of the share are 4 %
    lower, upper = ((height > -0.3) & (height < 0.0)).sum(), ((height >= 0.0) & (height < 0.4)).sum()
    thick, thin = 0.3 * (0.164 + 0.11) / 2, 0.4 * (0.11 + 0.038) / 2
    assert lower / (lower + upper) == pytest.approx(thick / (thick + thin), abs=0.05)


def test_the_side_and_the_ends_of_a_limb_get_their_share():
    limb = body_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.9), np.array([[0.1, 0.2], [0.05, 0.15]]), False)
    x, y, z = surface_points(limb, STANDING, 60000, np.random.default_rng(3)).T
    start = np.abs((x / 0.1) ** 2 + (y / 0.2) ** 2 + (z / 0.1) ** 2 - 1.0) < 1e-9
    end = np.abs((x / 0.05) ** 2 + (y / 0.15) ** 2 + ((z - 0.9) / 0.05) ** 2 - 1.0) < 1e-9
    side = np.abs((x / (0.1 - 0.05 * z / 0.9)) ** 2 + (y / (0.2 - 0.05 * z / 0.9)) ** 2 - 1.0) < 1e-9
    assert (start | end | side).all()
    t, phi = np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 2 * np.pi, 401), indexing="ij")

    def area(x, y, z):
        """Of a patch by the cross products of its grid's differences."""
        p = np.stack([x, y, z], axis=-1)
        return np.linalg.norm(np.cross(np.diff(p, axis=0)[:, :-1], np.diff(p, axis=1)[:-1]), axis=-1).sum()

    ring, level = np.sin(np.pi * t), np.cos(np.pi * t)
    areas = np.array([
        area(0.1 * ring * np.cos(phi), 0.2 * ring * np.sin(phi), 0.1 * level),
        area(0.05 * ring * np.cos(phi), 0.15 * ring * np.sin(phi), 0.05 * level),
        area((0.1 - 0.05 * t) * np.cos(phi), (0.2 - 0.05 * t) * np.sin(phi), 0.9 * t),
    ])  # fmt: skip
    found = np.array([part.mean() for part in (start, end, side)])
    assert np.abs(found - areas / areas.sum()).max() < 4 * np.sqrt(0.25 / len(x))  # 4 standard errors of a share


def test_nothing_is_seen_from_the_other_side_or_outside_the_image():
    away = replace(CAMERA, rotation=CAMERA.rotation * [[-1], [1], [-1]], translation=CAMERA.translation * [-1, 1, -1])
    assert len(visible_points(BODY, STANDING, away, 50, np.random.default_rng(0))) == 0
    narrow = replace(CAMERA, width=40, matrix=CAMERA.matrix - [[0, 0, 140], [0, 0, 0], [0, 0, 0]])
    seen = visible_points(BODY, STANDING, narrow, 400, np.random.default_rng(0))
    assert (np.abs(narrow.project(seen)[:, 0] - 19.5) <= 20.0).all()


def test_depth_errs_along_the_line_of_sight_and_with_the_distance_squared():
    rng = np.random.default_rng(4)
    far = np.repeat([[0.0, 0.0, 0.0], [0.0, 4.0, 0.5]], 20000, axis=0)
    noisy = with_depth_noise(far, CAMERA, 0.02, rng)
    assert np.allclose(CAMERA.project(noisy), CAMERA.project(far), atol=1e-9)
    depth = CAMERA.to_camera(far)[:, 2]
    error = CAMERA.to_camera(noisy)[:, 2] - depth
    for half in (slice(0, 20000), slice(20000, None)):
        sigma = 0.02 * (depth[half][0] / 4.0) ** 2
        assert error[half].std() == pytest.approx(sigma, rel=4 / np.sqrt(40000))  # 4 standard errors, σ / √(2 n)
        assert error[half].mean() == pytest.approx(0.0, abs=4 * sigma / np.sqrt(20000))
