"""The implicit surface by closed forms: its field, its pseudo-distance and the attachment of points to parts."""

from dataclasses import replace

import numpy as np
import pytest
import surface_scenes as scenes

from workbench.body.kinematics import forward
from workbench.body.surface import Surface, attach, residuals
from workbench.utils.errors import InputError

POSE = np.zeros(6)


def residuals_at(skeleton_and_surface, points, kind):
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    return residuals(*skeleton_and_surface, POSE, points, kind, np.zeros(len(points), dtype=np.int64))


def directions(n, seed=0):
    vectors = np.random.default_rng(seed).standard_normal((n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize(("sharpness", "level"), [(2.0, 1.0), (0.7, 1.0), (3.0, 0.25)])
def test_the_field_is_that_of_the_paper(sharpness, level):
    half = np.array([0.05, 0.08, 0.2])
    scene = scenes.lone(half, sharpness=sharpness, level=level)
    points = np.random.default_rng(1).normal(0.0, 0.1, (50, 3))
    d = np.sum((points / half) ** 2, axis=1)
    expected = level * np.exp(sharpness) * np.exp(-sharpness * d) - level
    np.testing.assert_allclose(residuals_at(scene, points, "field"), expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("kind", ["field", "distance"])
def test_the_skin_of_one_ellipsoid_is_the_ellipsoid(kind):
    half = np.array([0.05, 0.08, 0.2])
    skin = directions(100) * half
    np.testing.assert_allclose(residuals_at(scenes.lone(half, level=0.4), skin, kind), 0.0, atol=1e-15)
    outward = 1.0 if kind == "distance" else -1.0
    assert np.all(outward * residuals_at(scenes.lone(half), 1.01 * skin, kind) > 0.0)
    assert np.all(outward * residuals_at(scenes.lone(half), 0.99 * skin, kind) < 0.0)


def test_fields_of_a_part_add_up():
    skeleton, one = scenes.lone()
    two = Surface(
        names=("a", "b"),
        joints=np.zeros(2, dtype=np.int64),
        centers=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.08]]),
        half_sizes=np.array([[0.05] * 3, [0.04] * 3]),
        axes=np.stack([np.eye(3)] * 2),
        parts=np.zeros(2, dtype=np.int64),
        part_names=("both",),
    )
    point = np.array([[0.02, 0.01, 0.05]])
    fields = []
    for half, center in zip(two.half_sizes, two.centers, strict=True):
        alone = (skeleton, replace(one, half_sizes=half[None]))
        fields.append(residuals_at(alone, point - center, "field")[0] + 1.0)
    assert residuals_at((skeleton, two), point, "field")[0] == pytest.approx(sum(fields) - 1.0, rel=1e-12)


def test_the_distance_to_a_sphere_is_exact_outside_and_half_at_its_centre():
    sphere, radius = scenes.lone([0.05] * 3), 0.05
    distances = np.array([0.05, 0.051, 0.06, 0.1, 0.5, 3.0, 1000.0])
    points = directions(len(distances)) * distances[:, None]
    np.testing.assert_allclose(residuals_at(sphere, points, "distance"), distances - radius, rtol=1e-12, atol=1e-15)
    depths = np.array([1.0, 0.8, 0.5, 0.2, 0.0])  # of the radius, from the skin to the centre
    points = np.array([0.0, 0.6, 0.8]) * (radius * depths)[:, None]
    np.testing.assert_allclose(residuals_at(sphere, points, "distance"), radius * (depths**2 - 1.0) / 2.0, atol=1e-15)


# Least and largest ratio of the pseudo-distance to the distance 5 mm to 1 m outside, from the docstring of `surface`.
ACCURACY = {(0.05, 0.05, 0.08): (0.97, 1.00), (0.05, 0.05, 0.125): (0.88, 1.02), (0.1, 0.17, 0.35): (0.77, 1.07)}


@pytest.mark.parametrize(("half", "accuracy"), ACCURACY.items(), ids=str)
def test_the_distance_to_ellipsoids_is_as_accurate_as_stated(half, accuracy):
    half = np.array(half)
    skin = directions(20_000)
    skin /= np.linalg.norm(skin / half, axis=1, keepdims=True)
    normals = skin / half**2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ratios = [
        residuals_at(scenes.lone(half), skin + distance * normals, "distance") / distance
        for distance in (0.005, 0.02, 0.05, 0.2, 1.0)
    ]
    assert accuracy[0] - 0.005 <= np.min(ratios)  # the docstring states two digits
    assert np.max(ratios) <= accuracy[1] + 0.005
    close = residuals_at(scenes.lone(half), skin + 1e-7 * normals, "distance") / 1e-7
    np.testing.assert_allclose(close, 1.0, atol=1e-5)  # exact to first order


def test_points_are_attached_to_the_nearest_part():
    skeleton, surface = scenes.PERSON
    frames = forward(skeleton, np.zeros((1, 25)))
    offsets = {  # behind the calf, at the outer side of the hand, in front of the chest and of the nose
        "left_ankle": [-0.06, 0.0, 0.15], "left_wrist": [0.0, 0.07, -0.05], "neck": [0.15, 0.0, -0.2],
        "head_centre": [0.14, 0.0, 0.0],
    }  # fmt: skip
    points = np.array([frames.positions[0, skeleton.joint(joint)] + offset for joint, offset in offsets.items()])
    parts = attach(surface, frames, points)
    assert [surface.part_names[b] for b in parts] == ["left_calf", "left_hand", "torso", "head"]


def two_balls(near, far):
    """Return balls of the radii 0.03 and 0.15 m at x = near and x = far."""
    return replace(
        scenes.lone()[1],
        names=("small", "big"),
        joints=np.zeros(2, dtype=np.int64),
        centers=np.array([[near, 0.0, 0.0], [far, 0.0, 0.0]]),
        half_sizes=np.array([[0.03] * 3, [0.15] * 3]),
        axes=np.stack([np.eye(3)] * 2),
        parts=np.arange(2),
        part_names=("small", "big"),
    )


def parts_at(surface, points, kind):
    frames = forward(scenes.lone()[0], POSE[None])
    return [surface.part_names[b] for b in attach(surface, frames, np.array(points, dtype=np.float64), kind)]


def test_the_distance_favours_the_nearer_part_and_the_field_the_bigger():
    surface = two_balls(-0.1, 0.3)  # skins at −0.07 and 0.15 m
    points = [[0.02, 0.0, 0.0], [0.06, 0.0, 0.0]]
    assert parts_at(surface, points, "distance") == ["small", "big"]  # 9 and 13 cm; 13 and 9 cm
    assert parts_at(surface, points, "field") == ["big", "big"]  # d = 16 and 3.5


@pytest.mark.parametrize("kind", ["field", "distance"])
def test_attachment_does_not_underflow(kind):
    surface = two_balls(-1000.0, 1000.0)  # every field is exp(−10⁸) and less
    assert np.exp(-2.0 * (999.0 / 0.15) ** 2) == 0.0
    assert parts_at(surface, [[999.0, 0.0, 0.0], [-999.0, 0.0, 0.0], [-3000.0, 0.0, 0.0]], kind) == [
        "big", "small", "small" if kind == "distance" else "big",
    ]  # fmt: skip


def test_invalid_input_is_rejected():
    skeleton, surface = scenes.PERSON
    frames = forward(skeleton, np.zeros((1, 25)))
    with pytest.raises(InputError, match="finite points, found 2 non-finite ones"):
        attach(surface, frames, np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]]))
    with pytest.raises(InputError, match="positive half sizes"):
        replace(surface, half_sizes=-surface.half_sizes)
    with pytest.raises(InputError, match="part by part"):
        replace(surface, parts=surface.parts[::-1].copy())
    with pytest.raises(InputError, match="part by part"):
        replace(surface, part_names=(*surface.part_names, "tail"))
