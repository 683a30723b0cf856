"""The renderer against closed forms, the equations of the surfaces and the reference ray caster."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.oracles import rendering as oracle
from workbench.body.kinematics import forward
from workbench.body.limbs import Limbs, person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.datasets.rendering import render

BODY = person(from_height(1.75))
STANDING = np.zeros(25)
CAMERA = plain_camera(320, 240, 300.0, (0.3, -4.0, 0.4), (0.1, 0.0, 0.2))
RAYS = render.camera_rays(CAMERA, samples=1)
LIMITS = np.clip(BODY.skeleton.limits, -0.8, 1.5)


def ball(centre, radius):
    """Return a body of one sphere, fixed to the pelvis."""
    point = np.array([centre], dtype=float)
    limbs = Limbs(("ball",), np.array([0]), point, point, np.full((1, 2, 2), radius), np.array([True]))
    return replace(BODY, limbs=limbs)


def full_image(hits, camera, samples=1):
    """Return depth and limb for all pixels of the image."""
    depth = np.full((camera.height * samples, camera.width * samples), np.inf)
    limb = np.full(depth.shape, -1)
    window = np.s_[hits.top : hits.top + hits.depth.shape[0], hits.left : hits.left + hits.depth.shape[1]]
    depth[window], limb[window] = hits.depth, hits.limb
    return depth, limb


@st.composite
def poses(draw):
    unit = st.floats(0.0, 1.0, allow_nan=False)
    pose = LIMITS[:, 0] + np.array(draw(st.lists(unit, min_size=25, max_size=25))) * np.ptp(LIMITS, axis=1)
    pose[3] *= 4.0  # any heading
    return pose


@pytest.mark.parametrize("off_axis", [0.0, 0.8])
def test_area_and_depth_of_a_sphere_agree_with_closed_forms(off_axis):
    camera = plain_camera(640, 480, 500.0, (0.0, -3.0, 0.0), (0.0, 0.0, 0.0))
    samples, radius, distance = 3, 0.35, np.hypot(3.0, off_axis)
    rays = render.camera_rays(camera, samples)
    depth, limb = full_image(render.cast(ball((off_axis, 0.0, 0.0), radius), STANDING, camera, rays), camera, samples)
    # The image of the tangent cone of half-angle a, at the angle t to the optical axis, is an ellipse of area
    # π f² sin²a cos a / (cos²t − sin²a)^1.5.
    sin2, cos2t = (radius / distance) ** 2, (3.0 / distance) ** 2
    area = np.pi * 500.0**2 * sin2 * np.sqrt(1.0 - sin2) / (cos2t - sin2) ** 1.5
    # The number of lattice points in a disc of radius r has an error of about r^(2/3): 1 in 4000 here.
    assert (limb >= 0).sum() / samples**2 == pytest.approx(area, rel=1e-3)
    if off_axis == 0.0:
        assert depth.min() == pytest.approx(3.0 - radius, abs=1e-4)


def surface_misfit(pose, camera, depth, limb, k):
    """Return the distances, in radii, of the hits on limb k from its surface."""
    rows, columns = np.nonzero(limb == k)
    z = depth[rows, columns]
    x = (columns - camera.matrix[0, 2]) / camera.matrix[0, 0] * z
    y = (rows - camera.matrix[1, 2]) / camera.matrix[1, 1] * z
    world = (np.stack([x, y, z], axis=1) - camera.translation) @ camera.rotation
    frames, limbs = forward(BODY.skeleton, pose[None]), BODY.limbs
    joint = limbs.joints[k]
    local = (world - frames.positions[0, joint]) @ frames.rotations[0, joint]
    misfits = []
    for end, radii in ((limbs.starts[k], limbs.radii[k, 0]), (limbs.ends[k], limbs.radii[k, 1])):
        misfits.append(np.abs(np.linalg.norm((local - end) / [*radii, min(radii)], axis=1) - 1.0))
    axis = limbs.ends[k] - limbs.starts[k]
    if not limbs.spheres[k]:
        assert np.allclose(axis[:2], 0.0)  # the axis is z, and the cross-section is x and y
        t = (local - limbs.starts[k]) @ axis / (axis @ axis)
        section = np.outer(1.0 - t, limbs.radii[k, 0]) + np.outer(t, limbs.radii[k, 1])
        side = np.abs(np.linalg.norm(local[:, :2] / section, axis=1) - 1.0)
        misfits.append(np.where((t > -1e-9) & (t < 1.0 + 1e-9), side, np.inf))
    return np.min(misfits, axis=0)


@settings(max_examples=25, deadline=None)
@given(poses())
def test_hits_lie_on_the_surfaces_of_the_limbs(pose):
    depth, limb = full_image(render.cast(BODY, pose, CAMERA, RAYS), CAMERA)
    assert (limb >= 0).any()
    for k in range(len(BODY.limbs)):
        if (limb == k).any():
            # Directions have single precision: 6e-8 of 5 m is 0.3 µm, for radii from 3 cm.
            assert surface_misfit(pose, CAMERA, depth, limb, k).max() < 3e-5


@settings(max_examples=15, deadline=None)
@given(poses())
def test_the_kernel_agrees_with_its_reference(pose):
    camera = CAMERA.scaled(0.5)
    rays = render.camera_rays(camera, samples=1)
    depth, limb = full_image(render.cast(BODY, pose, camera, rays), camera)
    reference = oracle.cast(BODY, pose, camera, rays)
    # A tangential ray hits or misses by rounding: at most one pixel.
    assert ((limb >= 0) != (reference.limb >= 0)).sum() <= 1
    both = (limb >= 0) & (reference.limb >= 0)
    depth_errors = np.abs(depth[both] - reference.depth[both]) > 1e-9
    assert depth_errors.sum() <= 1
    assert (limb != reference.limb)[both].sum() <= 1


def test_the_silhouette_of_a_cone_is_the_hull_of_its_end_circles():
    calf = BODY.limbs.names.index("left_calf")
    rx = BODY.limbs.radii[calf, :, 0]
    camera = plain_camera(640, 480, 2000.0, (0.0, -4.0, -0.64), (0.0, 0.0, -0.64))
    limbs = BODY.limbs
    calf_only = Limbs(
        ("calf",), *(getattr(limbs, name)[calf : calf + 1] for name in ("joints", "starts", "ends", "radii", "spheres"))
    )
    hits = render.cast(replace(BODY, limbs=calf_only), STANDING, camera, render.camera_rays(camera, 1))
    depth, limb = full_image(hits, camera)
    knee = forward(BODY.skeleton, STANDING[None]).positions[0, BODY.skeleton.joint("left_knee")]
    for part in (0.2, 0.5, 0.8):
        height, radius = knee[2] - part * BODY.shape.calf, rx[0] * (1 - part) + rx[1] * part
        row = round(float(camera.project(np.array([knee[0], knee[1], height]))[1]))
        distance = knee[1] + 4.0
        # A circle of radius r at the distance d has the half-width r / sqrt(d² − r²) on the image plane.
        width_px = 2.0 * 2000.0 * radius / np.sqrt(distance**2 - radius**2)
        assert (limb[row] >= 0).sum() == pytest.approx(width_px, abs=1.5)
        assert depth[row].min() == pytest.approx(distance - radius, abs=2e-3)  # rays are up to 1 mm from that point


def test_a_body_behind_or_around_the_camera_is_rendered_as_by_the_reference():
    behind = STANDING.copy()
    behind[1] = -20.0
    assert render.cast(BODY, behind, CAMERA, RAYS).depth.size == 0
    crossing = STANDING.copy()
    crossing[:3] = CAMERA.position - [0.0, 0.0, 0.6]  # the camera's principal plane intersects the body
    depth, _ = full_image(render.cast(BODY, crossing, CAMERA, RAYS), CAMERA)
    assert np.allclose(depth, oracle.cast(BODY, crossing, CAMERA, RAYS).depth, rtol=0.0, atol=1e-9)


def test_rays_invert_the_distortion():
    distorted = replace(CAMERA, distortion=np.array([-0.25, 0.08, 0.002, -0.001, 0.0]))
    rays = render.camera_rays(distorted, samples=1)
    v, u = np.mgrid[0:240:13, 0:320:17]
    direction = np.concatenate([rays.directions[v, u], np.ones((*v.shape, 1))], axis=-1)
    world = distorted.position + 3.0 * direction @ distorted.rotation
    # OpenCV stops after five fixed-point iterations, with an error of 0.04 px in the corners.
    assert np.allclose(distorted.project(world), np.stack([u, v], axis=-1), atol=0.05)


def flat(body, grey):
    return render.Texture(np.zeros((4, 4, 4), np.float32), np.zeros((len(body.limbs), 3)), grey, 0.0)


def test_lambert_shading_of_a_ball():
    body, camera = ball((0.0, 0.0, 0.0), 0.5), plain_camera(201, 201, 300.0, (0.0, -3.0, 0.0), (0.0, 0.0, 0.0))
    scene = render.RenderedScene(body, camera, flat(body, np.array([200.0])), np.zeros((201, 201)))
    image = render.render(scene, STANDING)
    light = np.array([0.25, -0.45, 0.86]) / np.linalg.norm([0.25, -0.45, 0.86])
    # the central normal is −y; it changes by 1 / 50 per pixel of 1 cm
    assert image[100, 100] == pytest.approx(200.0 * (0.6 + 0.4 * -light[1]), abs=200.0 * 0.4 / 50)
    assert image[150:].min() == 0.0  # the background
    assert image.max() <= 200.0
    assert np.argmax(image.max(axis=1)) < 100  # lit from above


def test_the_texture_moves_with_the_limbs():
    texture = render.clothes(BODY, np.random.default_rng(3))
    black = np.zeros((CAMERA.height, CAMERA.width))
    shift = np.array([0.7, -0.4, 0.2])
    pose = STANDING.copy()
    pose[:3] = shift
    camera = replace(CAMERA, translation=CAMERA.translation - CAMERA.rotation @ shift)
    image = render.render(render.RenderedScene(BODY, CAMERA, texture, black), STANDING)
    shifted_image = render.render(render.RenderedScene(BODY, camera, texture, black), pose)
    assert np.abs(image - shifted_image).max() < 1e-6
    bent = STANDING.copy()
    bent[BODY.skeleton.dof("left_knee_flexion")] = 0.5
    scene = render.RenderedScene(BODY, CAMERA, texture, black)
    calf_pixels = np.zeros(black.shape, dtype=bool)
    for knee_pose in (STANDING, bent):
        _, limb = full_image(render.cast(BODY, knee_pose, CAMERA, scene.rays), CAMERA, scene.rays.samples)
        calf = (limb == BODY.limbs.names.index("left_calf")).reshape(CAMERA.height, 2, CAMERA.width, 2)
        calf_pixels |= calf.any(axis=(1, 3))
    change = np.abs(image - render.render(scene, bent))
    assert change[calf_pixels].max() > 10.0
    assert change[~calf_pixels].max() < 1e-6


def test_texture_background_and_noise_have_their_standard_deviations():
    texture = render.clothes(BODY, np.random.default_rng(0), contrast=0.5)
    assert texture.volume.std() == pytest.approx(1.0, abs=1e-3)
    assert texture.contrast == pytest.approx(0.5 * render.TEXTURE_GREY)
    background = render.background(240, 320, np.random.default_rng(0))
    assert background.std() == pytest.approx(render.CLUTTER_GREY, rel=0.05)  # reduced slightly by clipping
    assert np.array_equal(background, render.background(240, 320, np.random.default_rng(0)))
    assert np.ptp(render.background(240, 320, np.random.default_rng(0), clutter=0.0)) == 0.0
    noisy = render.with_noise(np.full((300, 300), 100.0), 4.0, np.random.default_rng(0))
    # rounding adds a variance of 1/12; the standard error of σ is σ / √(2 n) = 0.0094
    assert noisy.std() == pytest.approx(np.sqrt(16.0 + 1.0 / 12.0), abs=4 * 0.0094)
    assert noisy.mean() == pytest.approx(100.0, abs=4 * 4.0 / 300.0)
