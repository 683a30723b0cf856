"""The image-motion likelihood against closed forms: uniform images, shifted textures and occluding rods."""

from dataclasses import replace

import likelihood_scenes as scenes
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import kstest

from tests.oracles.image_motion import PosedView, hidden_samples, limb_patches
from workbench.body.kinematics import forward
from workbench.core.frame import View
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.image_motion import ImageMotion, random_samples, regular_samples

ROD = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.05))
BALL = scenes.rods(((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2))
SIGMA, EPSILON, P_OCCLUDED, N = 6.0, 0.05, 0.01, 50
GREY_ERROR = 1e-4  # error of a float32 grey level; times r / σ² it is the error in log p


def log_prob(body, now, pose, before=128, **options):
    frames = scenes.frame(0, (scenes.FRONT, scenes.flat(before))), scenes.frame(1, (scenes.FRONT, scenes.flat(now)))
    likelihood = ImageMotion(body, **{"sigma": SIGMA, "n_samples": N, **options})
    return scenes.log_prob(likelihood, *frames, pose, pose)


def p_limb(alpha, difference=0.0, visible=1.0, n=1):
    """Return p_j of paper A, eq. 10 and 11, for equal residuals."""
    sigma = SIGMA / np.cos(alpha)
    gaussian = np.exp(-n * difference**2 / (2 * sigma**2)) / (np.sqrt(2 * np.pi) * sigma)
    q = np.cos(alpha) * visible
    return q * (EPSILON / 256 + (1 - EPSILON) * gaussian) + (1 - q) * P_OCCLUDED


def patches(body, pose, camera=scenes.FRONT):
    image = np.zeros((camera.height, camera.width), np.float32)
    return limb_patches(body.limbs, PosedView(camera, image, forward(body.skeleton, pose)))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0, -1.4])
def test_a_uniform_image_gives_the_density_of_zero_residuals(alpha):
    """Pitch rotates the upright rod by α out of the image plane."""
    value = log_prob(ROD, 128, scenes.root(pitch=alpha))
    np.testing.assert_allclose(value, np.log(p_limb(alpha)), rtol=1e-12)
    np.testing.assert_allclose(patches(ROD, scenes.root(pitch=alpha)).cos_alpha, np.cos(alpha), rtol=1e-12)


def test_alpha_is_zero_for_rotations_in_the_image_plane():
    np.testing.assert_allclose(patches(ROD, scenes.root(roll=0.7)).cos_alpha, 1.0, rtol=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.8])
@pytest.mark.parametrize("difference", [3, 11, 60])
@pytest.mark.parametrize(("reduction", "n"), [("mean", 1), ("sum", 50)])
def test_a_uniform_change_gives_the_density_of_equal_residuals(alpha, difference, reduction, n):
    value = log_prob(ROD, 128 + difference, scenes.root(pitch=alpha), reduction=reduction)
    atol = n * difference * GREY_ERROR / SIGMA**2
    np.testing.assert_allclose(value, np.log(p_limb(alpha, difference, n=n)), atol=atol)


@pytest.mark.parametrize("alpha", [0.0, 0.8])
@pytest.mark.parametrize("difference", [0, 11, 60])
def test_a_static_background_subtracts_the_log_density_of_no_motion(alpha, difference):
    """The log density of the same points without motion is 0 in a constant image."""
    value = log_prob(ROD, 128 + difference, scenes.root(pitch=alpha), background="static")
    no_motion = np.log(p_limb(0.0, difference) / p_limb(0.0))
    atol = 2 * difference * GREY_ERROR / SIGMA**2
    np.testing.assert_allclose(value, np.log(p_limb(alpha, difference)) - no_motion, atol=max(atol, 1e-12))


def test_a_static_background_distinguishes_a_moving_limb_from_one_at_rest():
    """A texture moves with the rod by 6 px, 8 cm; a rod at rest at a distance of 80 cm is in a constant part."""
    before = scenes.texture(np.random.default_rng(4))
    corners = patches(ROD, scenes.root()).corners[0, 0].reshape(-1, 2)
    (left, top), (right, bottom) = (corners.min(axis=0) - 10).astype(int), (corners.max(axis=0) + 10).astype(int)
    now = before.copy()
    now[top:bottom, left + 6 : right + 6] = before[top:bottom, left:right]
    frames = scenes.frame(0, (scenes.FRONT, before)), scenes.frame(1, (scenes.FRONT, now))
    at_rest, moving = scenes.root((0.0, 0.8, 0.0)), scenes.root((0.0, 0.08, 0.0))
    previous, poses = np.concatenate([scenes.root(), at_rest]), np.concatenate([moving, at_rest])
    without, static = (
        scenes.log_prob(ImageMotion(ROD, sigma=SIGMA, background=kind), *frames, previous, poses)
        for kind in ("none", "static")
    )
    assert abs(without[0] - without[1]) < 0.1  # the likelihood of the paper does not distinguish them
    assert static[0] - static[1] > 2.0


def test_effective_pixels_multiply_the_exponent():
    value = log_prob(ROD, 128 + 5, scenes.root(), effective_pixels=2.5)
    np.testing.assert_allclose(value, np.log(p_limb(0.0, 5.0 * np.sqrt(2.5))), atol=2.5 * 5.0 * GREY_ERROR / SIGMA**2)


@pytest.mark.parametrize("pitch", [0.0, 0.5, 1.2, np.pi / 2])
def test_the_likelihood_of_a_sphere_does_not_depend_on_its_angle(pitch):
    """Except for a sphere viewed along its axis, which has no patch."""
    expected = P_OCCLUDED if pitch == np.pi / 2 else p_limb(0.0)
    np.testing.assert_allclose(log_prob(BALL, 128, scenes.root(pitch=pitch)), np.log(expected), rtol=1e-12)


def test_the_log_density_without_outliers_and_occlusion_has_no_lower_bound():
    """The density underflows for ε = 0 and q = 1, but not its logarithm."""
    value = log_prob(BALL, 255, scenes.root(), before=0, outlier_fraction=0.0, reduction="sum")
    gaussian = -50 * 255.0**2 / (2 * SIGMA**2) - np.log(np.sqrt(2 * np.pi) * SIGMA)
    np.testing.assert_allclose(value, gaussian, atol=50 * 255.0 * GREY_ERROR / SIGMA**2)


def test_a_body_behind_the_camera_is_fully_occluded():
    likelihood = ImageMotion(scenes.PERSON)
    frames = (scenes.frame(i, (scenes.FRONT, scenes.flat(128))) for i in range(2))
    pose = scenes.root((scenes.DISTANCE + 3.0, 0.0, 0.0))
    evaluation = likelihood.prepare(*frames).evaluate(pose, pose)
    np.testing.assert_allclose(evaluation.log_prob, 12 * np.log(P_OCCLUDED), rtol=1e-12)
    assert evaluation.notes == ("image motion: 100% of the sample points lay outside the images of front",)


def test_the_patch_of_an_upright_rod_is_its_projection():
    """At 4 m and f = 300 px, 1 m is 75 px: 0.6 m × 0.1 m are 45 × 7.5 px around the centre of the image."""
    corners = patches(ROD, scenes.root()).corners[0, 0]
    centre = np.array([(scenes.WIDTH - 1) / 2, (scenes.HEIGHT - 1) / 2])
    expected = [[[-3.75, 22.5], [3.75, 22.5]], [[-3.75, -22.5], [3.75, -22.5]]]  # start below, end above
    np.testing.assert_allclose(corners, centre + expected, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 0.5, np.pi / 4, np.pi / 2])
def test_the_width_of_the_torso_is_that_of_its_projected_ellipse(heading):
    """The half-width of an ellipse rotated by φ is √((rx sin φ)² + (ry cos φ)²)."""
    rx, ry = scenes.PERSON.limbs.radii[0, 0]
    width = np.diff(patches(scenes.PERSON, scenes.root(heading=heading)).corners[0, 0, 0, :, 0])[0]
    expected = 2.0 * 75.0 * np.hypot(rx * np.sin(heading), ry * np.cos(heading))
    np.testing.assert_allclose(width, expected, rtol=1e-9)


def test_the_patch_of_a_sphere_is_inscribed_in_its_outline():
    corners = patches(BALL, scenes.root()).corners[0, 0].reshape(4, 2)
    centre = np.array([(scenes.WIDTH - 1) / 2, (scenes.HEIGHT - 1) / 2])
    np.testing.assert_allclose(np.linalg.norm(corners - centre, axis=1), 0.2 * 75.0, rtol=1e-9)
    assert np.ptp(np.abs(corners - centre)) < 1e-9  # sides parallel to those of the image


def test_sample_positions_interpolate_the_corners_of_a_patch():
    person_patches = patches(scenes.PERSON, scenes.root(pitch=0.4, heading=0.6, roll=0.2))
    positions, corners = (
        person_patches.positions(np.array([[0.0, -1.0], [1.0, 1.0], [0.5, 0.0]])),
        person_patches.corners,
    )
    np.testing.assert_allclose(positions[:, :, :2], corners[:, :, [0, 1], [0, 1]])
    np.testing.assert_allclose(positions[:, :, 2], corners.mean(axis=(2, 3)))


@pytest.mark.parametrize("shift", [(6, 0), (-4, 0), (0, 5), (3, -3)])
@pytest.mark.parametrize("body", [ROD, BALL], ids=["rod", "ball"])
def test_the_maximum_is_at_the_displacement_of_the_texture(body, shift):
    texture = scenes.texture(np.random.default_rng(3))
    frames = scenes.frame(0, (scenes.FRONT, texture)), scenes.frame(1, (scenes.FRONT, np.roll(texture, shift, (1, 0))))
    steps = np.arange(-8, 9)
    dx, dy = np.meshgrid(steps, steps)
    poses = np.repeat(scenes.root(), dx.size, axis=0)
    poses[:, 1], poses[:, 2] = dx.ravel() / 75.0, -dy.ravel() / 75.0  # px to metres; image y points down
    values = scenes.log_prob(ImageMotion(body, sigma=SIGMA), *frames, np.zeros_like(poses), poses)
    best = np.argmax(values)
    assert (dx.ravel()[best], dy.ravel()[best]) == shift
    # the residuals of a shift by integer pixels are zero up to float32
    np.testing.assert_allclose(values[best], np.log(p_limb(0.0)), atol=1e-4)
    assert np.partition(values, -2)[-2] < values[best] - 0.1


def arm_before_torso(distance):
    """Return a wide rod and, nearer to the camera by `distance`, m, a thin and longer one."""
    return scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.2), ((distance, 0.0, -0.5), (distance, 0.0, 0.5), 0.04))


def occluded_scale(distance):
    """Return the ratio of lengths at `distance`, m, in front of the wide rod and the lengths that they occlude."""
    return (scenes.DISTANCE - distance) / scenes.DISTANCE


def test_an_arm_in_front_of_the_torso_occludes_the_samples_behind_it():
    body = arm_before_torso(0.3)
    samples = ImageMotion(body, n_samples=200).samples
    expected = np.abs(0.2 * samples[:, 1]) * occluded_scale(0.3) < 0.04
    assert 10 < expected.sum() < 60
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")[0]
    np.testing.assert_array_equal(hidden[0], expected)
    assert not hidden[1].any()

    value = log_prob(body, 128, scenes.root(), n_samples=200)
    torso = p_limb(0.0, visible=1.0 - expected.mean())
    np.testing.assert_allclose(value, np.log(torso) + np.log(p_limb(0.0)), rtol=1e-12)


def test_an_arm_behind_the_torso_is_occluded():
    body, samples = arm_before_torso(-0.3), regular_samples(200, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")[0]
    expected = np.abs(samples[:, 0] - 0.5) < 0.3 * occluded_scale(-0.3)  # the arm is 1 m long, the torso 0.6 m
    assert 20 < expected.sum() < 180
    np.testing.assert_array_equal(hidden[1], expected)
    assert not hidden[0].any()


@pytest.mark.parametrize(("distance", "hides"), [(0.119, False), (0.121, True)])
def test_limbs_closer_than_half_the_sum_of_their_radii_do_not_occlude_each_other(distance, hides):
    body, samples = arm_before_torso(distance), regular_samples(100, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")
    assert hidden.any() == hides


@pytest.mark.parametrize(("occlusion", "p_torso"), [("limb", P_OCCLUDED), ("none", p_limb(0.0))])
def test_the_farther_limb_is_hidden_as_a_whole_or_not_at_all(occlusion, p_torso):
    value = log_prob(arm_before_torso(0.3), 128, scenes.root(), occlusion=occlusion)
    np.testing.assert_allclose(value, np.log(p_torso) + np.log(p_limb(0.0)), rtol=1e-12)


def test_occlusion_by_limb_orders_limbs_by_their_nearest_surface():
    """The axis of the thin rod is nearer by 0.1 m, but the wide rod has a radius of 0.2 m."""
    body, samples = arm_before_torso(0.1), regular_samples(100, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "limb")[0]
    assert hidden[1].all()
    assert not hidden[0].any()


def test_limbs_that_continue_each_other_do_not_occlude_each_other_as_a_whole():
    """In a walk seen from its right side, the hidden limbs are those behind another one. The right arm hangs beside
    the torso; its forearm and its hand are a little nearer, as the arm is abducted and the elbow flexed."""
    body, poses = scenes.PERSON, scenes.root(heading=np.pi / 2)
    for name, angle in {"left_hip_flexion": 0.3, "right_hip_flexion": -0.3, "right_shoulder_abduction": 0.1}.items():
        poses[0, body.skeleton.dof(name)] = angle
    poses[0, [body.skeleton.dof(f"{side}_elbow_flexion") for side in ("left", "right")]] = 0.4
    samples = random_samples(200, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, poses), samples, "limb")[0]
    np.testing.assert_array_equal(hidden.all(axis=1), hidden.any(axis=1))
    shown = {name for name, each in zip(body.limbs.names, hidden, strict=True) if not each.any()}
    assert {"right_upper_arm", "right_forearm", "right_hand", "right_calf"} <= shown
    assert {"left_upper_arm", "left_forearm", "left_thigh", "torso"}.isdisjoint(shown)


def test_a_sphere_occludes_a_disc():
    body = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.2), ((0.5, 0.05, 0.02), (0.5, 0.05, 0.02), 0.12))
    samples = regular_samples(300, np.random.default_rng(0))
    body_patches = patches(body, scenes.root())
    hidden = hidden_samples(body.limbs, body_patches, samples, "sample")[0, 0]
    ratio = scenes.FOCAL / (scenes.DISTANCE - 0.5)
    centre = np.array([(scenes.WIDTH - 1) / 2 + 0.05 * ratio, (scenes.HEIGHT - 1) / 2 - 0.02 * ratio])
    distances = np.linalg.norm(body_patches.positions(samples)[0, 0] - centre, axis=1)
    expected = distances < 0.12 * ratio
    # the patch faces the camera instead of the image plane: points within 1 % of the outline are omitted
    off_outline = np.abs(distances / (0.12 * ratio) - 1.0) > 0.01
    assert 20 < expected.sum() < 200
    np.testing.assert_array_equal(hidden[off_outline], expected[off_outline])


def test_points_outside_of_the_image_decrease_the_visible_fraction():
    """The lower part of the rod is outside of the image: y = 119.5 + 75 (0.3 − 0.6 u + 1.5) px is above 239."""
    likelihood = ImageMotion(ROD, sigma=SIGMA, n_samples=N)
    frames = [scenes.frame(i, (scenes.FRONT, scenes.flat(128))) for i in range(2)]
    pose = scenes.root((0.0, 0.0, -1.5))
    inside = 119.5 + 75.0 * (0.3 - 0.6 * likelihood.samples[:, 0] + 1.5) < 239.0
    assert 10 < inside.sum() < 40
    frame_likelihood = likelihood.prepare(*frames)
    evaluation = frame_likelihood.evaluate(pose, pose)
    np.testing.assert_allclose(evaluation.log_prob, np.log(p_limb(0.0, visible=inside.mean())), rtol=1e-12)
    fraction = f"{1 - inside.mean():.0%}"
    assert evaluation.notes == (f"image motion: {fraction} of the sample points lay outside the images of front",)
    # a point outside in either frame is not compared
    np.testing.assert_array_equal(frame_likelihood.evaluate(pose, scenes.root()).log_prob, evaluation.log_prob)
    np.testing.assert_array_equal(frame_likelihood.evaluate(scenes.root(), pose).log_prob, evaluation.log_prob)


@pytest.mark.parametrize(("reduction", "n"), [("mean", lambda compared: 1), ("sum", lambda compared: compared)])
def test_the_exponent_is_that_of_the_compared_points(reduction, n):
    """The mean or the sum is over the points inside the image."""
    pose = scenes.root((0.0, 0.0, -1.5))
    inside = 119.5 + 75.0 * (1.8 - 0.6 * ImageMotion(ROD, n_samples=N).samples[:, 0]) < 239.0
    value = log_prob(ROD, 128 + 7, pose, reduction=reduction)
    expected = np.log(p_limb(0.0, 7.0, visible=inside.mean(), n=n(inside.sum())))
    np.testing.assert_allclose(value, expected, atol=50 * 7.0 * GREY_ERROR / SIGMA**2)


def test_images_are_smoothed_by_a_gaussian():
    rgb = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    grey = rgb @ np.array([0.299, 0.587, 0.114])  # Rec. 601
    expected = gaussian_filter(grey, np.sqrt(2.0), mode="mirror")
    np.testing.assert_allclose(grey_levels(View(scenes.FRONT, rgb), np.sqrt(2.0)), expected, atol=1e-3)


def test_regular_samples_are_uniform_in_each_coordinate():
    samples = regular_samples(50, np.random.default_rng(0))
    assert samples.shape == (50, 2)
    for column, (low, high) in zip(samples.T, ((0.08, 0.92), (-0.8, 0.8)), strict=True):
        counts, _ = np.histogram(column, bins=10, range=(low, high))
        assert counts.sum() == 50
        assert counts.min() >= 3  # 70 % of independent uniform samples have fewer in some bin


def test_random_samples_are_uniform_over_the_patch():
    samples = random_samples(20_000, np.random.default_rng(0))
    for column, (low, high) in zip(samples.T, ((0.0, 1.0), (-1.0, 1.0)), strict=True):
        assert kstest(column, "uniform", (low, high - low)).pvalue > 0.01
    assert abs(np.corrcoef(samples.T)[0, 1]) < 0.03


def test_a_limb_without_taper_is_the_cylinder_of_its_mean_radius():
    cone = replace(ROD, limbs=replace(ROD.limbs, radii=np.array([[[0.02, 0.02], [0.08, 0.08]]])))
    texture = scenes.texture(np.random.default_rng(0))
    frames = [scenes.frame(0, (scenes.FRONT, texture)), scenes.frame(1, (scenes.FRONT, np.roll(texture, 2, axis=1)))]
    pose = scenes.root()
    cylinder, expected, tapered_value = (
        scenes.log_prob(ImageMotion(body, taper=taper), *frames, pose, pose)
        for body, taper in ((cone, False), (ROD, True), (cone, True))
    )
    np.testing.assert_allclose(cylinder, expected, rtol=1e-12)
    assert abs(tapered_value - expected) > 1e-3
