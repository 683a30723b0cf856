"""The surfaces of bodies: a person's lies on the limbs' cones, any skeleton's along its bones."""

from dataclasses import replace

import numpy as np
import pytest
import surface_scenes as scenes

from tests.oracles.surface import log_fields
from workbench.body.kinematics import forward
from workbench.body.limbs import person, skeleton_limbs
from workbench.body.shape import from_height
from workbench.body.surface import attach, limbs_surface, person_surface, residuals
from workbench.utils.errors import InputError

NEUTRAL = np.zeros(25)


def skin_over_cone(body, limb, along, angles):
    """Return the distance (A, N), m, of a limb's skin from its cone at fractions (A,) of its axis and angles (N,)."""
    surface, limbs = person_surface(body), body.limbs
    frames = forward(body.skeleton, NEUTRAL[None])
    start = frames.positions[0, limbs.joints[limb]] + limbs.starts[limb]
    axis = limbs.ends[limb] - limbs.starts[limb]
    radii = limbs.radii[limb, 0] + along[:, None] * (limbs.radii[limb, 1] - limbs.radii[limb, 0])
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    across = circle * np.column_stack([radii, np.zeros(len(along))])[:, None]
    low, high = np.zeros(across.shape[:2]), np.full(across.shape[:2], 2.0)  # of the radius; the field falls outwards
    for _ in range(16):
        middle = 0.5 * (low + high)
        points = start + along[:, None, None] * axis + middle[..., None] * across
        inside = log_fields(surface, frames, points.reshape(-1, 3))[:, limb].reshape(middle.shape) > 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return (low - 1.0) * np.linalg.norm(across, axis=-1)


@pytest.mark.parametrize("height", [1.5, 1.95])
def test_the_persons_skin_lies_on_the_cones(height):
    body, along = person(from_height(height)), np.linspace(0.0, 1.0, 21)
    angles = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)
    for limb in np.flatnonzero(~body.limbs.spheres):
        over = skin_over_cone(body, limb, along, angles)
        # 1 cm along a limb; at its ends, which the next limb covers, the skin closes by at most 2 cm
        assert np.abs(over[2:-2]).max() < 0.01, body.limbs.names[limb]
        assert np.abs(over).max() < 0.02, body.limbs.names[limb]


def test_spheres_are_spheres():
    limbs = scenes.BODY.limbs
    surface = scenes.PERSON[1]
    for name in ("head", "left_hand", "right_hand"):
        limb, part = limbs.names.index(name), surface.part_names.index(name)
        [row] = np.flatnonzero(surface.parts == part)
        np.testing.assert_array_equal(surface.half_sizes[row], limbs.radii[limb, 0, 0])
        np.testing.assert_array_equal(surface.centers[row], limbs.starts[limb])


def test_parts_are_the_limbs_on_their_joints():
    surface, limbs = scenes.PERSON[1], scenes.BODY.limbs
    assert surface.part_names == limbs.names
    np.testing.assert_array_equal(surface.joints, limbs.joints[surface.parts])
    assert surface.names[:4] == ("torso_1", "torso_2", "torso_3", "head")
    mirrored = [name.replace("left", "right") for name in surface.names if name.startswith("left")]
    assert mirrored == [name for name in surface.names if name.startswith("right")]


@pytest.mark.parametrize("seed", range(2))
def test_any_skeleton_has_a_skin_along_its_bones(seed):
    skeleton = scenes.tree(seed)
    surface = limbs_surface(skeleton_limbs(skeleton, thickness=0.15))
    assert surface.part_names == skeleton.names[1:]  # every bone, by its far joint
    pose = np.random.default_rng(seed).normal(0.0, 1.0, len(skeleton.dof_names))
    frames = forward(skeleton, pose[None])
    for part, (parent, child) in enumerate(skeleton.bones):
        start, bone = frames.positions[0, parent], frames.positions[0, child] - frames.positions[0, parent]
        inner = start + np.linspace(0.0, 1.0, 9)[:, None] * bone
        across = np.cross(bone, [0.3, -0.5, 0.8])
        across *= 0.15 * np.linalg.norm(bone) / np.linalg.norm(across)
        parts = np.full(7, part)
        assert np.all(residuals(skeleton, surface, pose, inner[1:-1], "distance", parts) < 0.0)
        distances = residuals(skeleton, surface, pose, inner[1:-1] + across, "distance", parts)
        # chains of ellipsoids are within 2 % of the radius in theory, for a = 2, and less close near the ends
        assert np.abs(distances).max() < 0.05 * np.linalg.norm(across)


def test_radii_and_ends_can_be_chosen():
    skeleton = scenes.BODY.skeleton
    surface = limbs_surface(
        skeleton_limbs(skeleton, radii={"left_knee": (0.09, 0.07)}, ends={"left_wrist": (0.18, 0.02, 0.05)})
    )
    thigh = surface.half_sizes[surface.parts == surface.part_names.index("left_knee")]
    np.testing.assert_allclose(thigh[:, :2], [[0.09, 0.07]] * len(thigh))
    wrist = skeleton.joint("left_wrist")
    assert set(surface.joints[surface.parts == surface.part_names.index("left_wrist_end")]) == {wrist}
    frames = forward(skeleton, NEUTRAL[None])
    fingers = frames.positions[0, wrist] + [0.0, 0.0, -0.15]
    assert surface.part_names[attach(surface, frames, fingers[None])[0]] == "left_wrist_end"
    side = frames.positions[0, wrist] + [[0.0, 0.05, -0.09], [0.02, 0.0, -0.09]]
    parts = np.full(2, surface.part_names.index("left_wrist_end"))
    # 5 % of a half size, as above
    assert np.abs(residuals(skeleton, surface, NEUTRAL, side, "distance", parts)).max() < 0.0025


def test_unknown_joints_and_skeletons_without_bones_are_rejected():
    with pytest.raises(InputError, match="no joint 'tail'"):
        limbs_surface(skeleton_limbs(scenes.BODY.skeleton, radii={"tail": (0.1, 0.1)}))
    with pytest.raises(InputError, match="expected a skeleton with bones"):
        limbs_surface(skeleton_limbs(scenes.lone()[0]))


def test_bones_without_a_length_have_no_skin():
    skeleton = scenes.BODY.skeleton
    offsets = skeleton.offsets.copy()
    offsets[skeleton.joint("neck")] = 0.0
    assert "neck" not in limbs_surface(skeleton_limbs(replace(skeleton, offsets=offsets))).part_names
