"""The image-motion likelihood where the answer is known: flat images, shifted textures, rods in front of rods."""

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
GREY = 1e-4  # what float32 smoothing and interpolation may do to a grey level; times r / σ² it is an error in log p


def log_prob(body, now, pose, before=128, previous_pose=None, **options):
    frames = scenes.frame(0, (scenes.FRONT, scenes.flat(before))), scenes.frame(1, (scenes.FRONT, scenes.flat(now)))
    likelihood = ImageMotion(body, **{"sigma": SIGMA, "n_samples": N, **options})
    return scenes.log_prob(likelihood, *frames, pose if previous_pose is None else previous_pose, pose)


def p_limb(alpha, difference=0.0, visible=1.0, n=1):
    """p_j of paper A eq. 10 and 11 for residuals that are all equal, by hand."""
    sigma = SIGMA / np.cos(alpha)
    gaussian = np.exp(-n * difference**2 / (2 * sigma**2)) / (np.sqrt(2 * np.pi) * sigma)
    q = np.cos(alpha) * visible
    return q * (EPSILON / 256 + (1 - EPSILON) * gaussian) + (1 - q) * P_OCCLUDED


def patches(body, pose, camera=scenes.FRONT):
    image = np.zeros((camera.height, camera.width), np.float32)
    return limb_patches(body.limbs, PosedView(camera, image, forward(body.skeleton, pose)))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0, -1.4])
def test_still_image_of_a_tilted_rod(alpha):
    """Pitch tilts the upright rod towards the camera, so that it makes the angle α with the image plane."""
    found = log_prob(ROD, 128, scenes.root(pitch=alpha))
    np.testing.assert_allclose(found, np.log(p_limb(alpha)), rtol=1e-12)
    np.testing.assert_allclose(patches(ROD, scenes.root(pitch=alpha)).cos_alpha, np.cos(alpha), rtol=1e-12)


def test_turning_in_the_image_plane_leaves_alpha_at_zero():
    np.testing.assert_allclose(patches(ROD, scenes.root(roll=0.7)).cos_alpha, 1.0, rtol=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.8])
@pytest.mark.parametrize("difference", [3, 11, 60])
@pytest.mark.parametrize(("exponent", "n"), [("mean", 1), ("sum", 50)])
def test_image_that_brightens_everywhere(alpha, difference, exponent, n):
    found = log_prob(ROD, 128 + difference, scenes.root(pitch=alpha), reduction=exponent)
    np.testing.assert_allclose(found, np.log(p_limb(alpha, difference, n=n)), atol=n * difference * GREY / SIGMA**2)


@pytest.mark.parametrize("alpha", [0.0, 0.8])
@pytest.mark.parametrize("difference", [0, 11, 60])
def test_a_still_background_is_paid_for_by_what_it_would_have_said(alpha, difference):
    """log p of the limb less log p of the same points under no motion, which is 0 where nothing changes."""
    found = log_prob(ROD, 128 + difference, scenes.root(pitch=alpha), background="static")
    unmoved = np.log(p_limb(0.0, difference) / p_limb(0.0))
    atol = 2 * difference * GREY / SIGMA**2
    np.testing.assert_allclose(found, np.log(p_limb(alpha, difference)) - unmoved, atol=max(atol, 1e-12))


def test_before_a_still_background_the_limb_that_moves_beats_the_one_at_rest():
    """A texture moves with the rod, 6 px or 8 cm to the right; a rod at rest 80 cm beside it sees no change at all."""
    before = scenes.texture(np.random.default_rng(4), scenes.WIDTH, scenes.HEIGHT)
    corners = patches(ROD, scenes.root()).corners[0, 0].reshape(-1, 2)
    (left, top), (right, bottom) = (corners.min(axis=0) - 10).astype(int), (corners.max(axis=0) + 10).astype(int)
    now = before.copy()
    now[top:bottom, left + 6 : right + 6] = before[top:bottom, left:right]
    frames = scenes.frame(0, (scenes.FRONT, before)), scenes.frame(1, (scenes.FRONT, now))
    at_rest, moved = scenes.root((0.0, 0.8, 0.0)), scenes.root((0.0, 0.08, 0.0))
    previous, poses = np.concatenate([scenes.root(), at_rest]), np.concatenate([moved, at_rest])
    paper, still = (
        scenes.log_prob(ImageMotion(ROD, sigma=SIGMA, background=kind), *frames, previous, poses)
        for kind in ("none", "static")
    )
    assert abs(paper[0] - paper[1]) < 0.1  # the paper's likelihood cannot tell them apart
    assert still[0] - still[1] > 2.0


def test_k_multiplies_the_exponent():
    found = log_prob(ROD, 128 + 5, scenes.root(), effective_pixels=2.5)
    np.testing.assert_allclose(found, np.log(p_limb(0.0, 5.0 * np.sqrt(2.5))), atol=2.5 * 5.0 * GREY / SIGMA**2)


def test_sphere_has_no_angle():
    for pitch in (0.0, 0.5, 1.2):
        np.testing.assert_allclose(log_prob(BALL, 128, scenes.root(pitch=pitch)), np.log(p_limb(0.0)), rtol=1e-12)


def test_sphere_seen_along_its_own_axis_has_no_upright_patch():
    np.testing.assert_allclose(log_prob(BALL, 128, scenes.root(pitch=np.pi / 2)), np.log(P_OCCLUDED), rtol=1e-12)


def test_without_outliers_and_occlusion_there_is_no_floor():
    """ε = 0 and q = 1: the logarithm goes on falling where the density itself underflows."""
    found = log_prob(BALL, 255, scenes.root(), before=0, outlier_fraction=0.0, reduction="sum")
    gaussian = -50 * 255.0**2 / (2 * SIGMA**2) - np.log(np.sqrt(2 * np.pi) * SIGMA)
    np.testing.assert_allclose(found, gaussian, atol=50 * 255.0 * GREY / SIGMA**2)


def test_body_behind_the_camera_is_occluded_altogether():
    likelihood = ImageMotion(scenes.PERSON)
    frames = (scenes.frame(i, (scenes.FRONT, scenes.flat(128))) for i in range(2))
    pose = scenes.root((scenes.DISTANCE + 3.0, 0.0, 0.0))
    found = likelihood.prepare(*frames).evaluate(pose, pose)
    np.testing.assert_allclose(found.log_prob, 12 * np.log(P_OCCLUDED), rtol=1e-12)
    assert found.notes == ("image motion: 100% of the sample points lay outside the images of front",)


def test_patch_of_an_upright_rod():
    """At 4 m and f = 300 px a metre is 75 px: 0.6 m by 2 × 0.05 m become 45 by 7.5 px around the image's centre."""
    corners = patches(ROD, scenes.root()).corners[0, 0]
    centre = np.array([(scenes.WIDTH - 1) / 2, (scenes.HEIGHT - 1) / 2])
    expected = [[[-3.75, 22.5], [3.75, 22.5]], [[-3.75, -22.5], [3.75, -22.5]]]  # start below, end above
    np.testing.assert_allclose(corners, centre + expected, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 0.5, np.pi / 4, np.pi / 2])
def test_half_width_of_the_torso(heading):
    """Half the width of an ellipse's shadow: √((rx sin)² + (ry cos)²) at the angle it is turned by."""
    rx, ry = scenes.PERSON.limbs.radii[0, 0]
    width = np.diff(patches(scenes.PERSON, scenes.root(heading=heading)).corners[0, 0, 0, :, 0])[0]
    expected = 2.0 * 75.0 * np.hypot(rx * np.sin(heading), ry * np.cos(heading))
    np.testing.assert_allclose(width, expected, rtol=1e-9)


def test_sphere_patch_is_inscribed_in_its_outline():
    corners = patches(BALL, scenes.root()).corners[0, 0].reshape(4, 2)
    centre = np.array([(scenes.WIDTH - 1) / 2, (scenes.HEIGHT - 1) / 2])
    np.testing.assert_allclose(np.linalg.norm(corners - centre, axis=1), 0.2 * 75.0, rtol=1e-9)
    assert np.ptp(np.abs(corners - centre)) < 1e-9  # upright: its sides are the image's


def test_samples_in_a_tapered_patch_interpolate_its_corners():
    found = patches(scenes.PERSON, scenes.root(pitch=0.4, heading=0.6, roll=0.2))
    np.testing.assert_allclose(
        found.positions(np.array([[0.0, -1.0], [1.0, 1.0]])), found.corners[:, :, [0, 1], [0, 1]]
    )
    middle = found.positions(np.array([[0.5, 0.0]]))[:, :, 0]
    np.testing.assert_allclose(middle, found.corners.mean(axis=(2, 3)))


@pytest.mark.parametrize("shift", [(6, 0), (-4, 0), (0, 5), (3, -3)])
@pytest.mark.parametrize("body", [ROD, BALL], ids=["rod", "ball"])
def test_a_shifted_texture_is_best_explained_by_the_true_displacement(body, shift):
    texture = scenes.texture(np.random.default_rng(3))
    frames = scenes.frame(0, (scenes.FRONT, texture)), scenes.frame(1, (scenes.FRONT, np.roll(texture, shift, (1, 0))))
    steps = np.arange(-8, 9)
    dx, dy = np.meshgrid(steps, steps)
    poses = np.repeat(scenes.root(), dx.size, axis=0)
    poses[:, 1], poses[:, 2] = dx.ravel() / 75.0, -dy.ravel() / 75.0  # px to metres; image y points down
    found = scenes.log_prob(ImageMotion(body, sigma=SIGMA), *frames, np.zeros_like(poses), poses)
    best = np.argmax(found)
    assert (dx.ravel()[best], dy.ravel()[best]) == shift
    # the shift is one of whole pixels: nothing differs at the truth, up to float32
    np.testing.assert_allclose(found[best], np.log(p_limb(0.0)), atol=1e-4)
    assert np.partition(found, -2)[-2] < found[best] - 0.1


def arm_before_torso(distance):
    """A broad rod, and `distance` metres nearer to the camera a thin and longer one in front of its middle."""
    return scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.2), ((distance, 0.0, -0.5), (distance, 0.0, 0.5), 0.04))


def shadow(distance):
    """How much smaller something at `distance` before the broad rod's plane is that just covers a length there."""
    return (scenes.DISTANCE - distance) / scenes.DISTANCE


def test_arm_before_the_torso_hides_what_it_covers():
    body = arm_before_torso(0.3)
    samples = ImageMotion(body, n_samples=200).samples
    expected = np.abs(0.2 * samples[:, 1]) * shadow(0.3) < 0.04
    assert 10 < expected.sum() < 60
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")[0]
    np.testing.assert_array_equal(hidden[0], expected)
    assert not hidden[1].any()

    likelihood_value = log_prob(body, 128, scenes.root(), n_samples=200)
    torso = p_limb(0.0, visible=1.0 - expected.mean())
    np.testing.assert_allclose(likelihood_value, np.log(torso) + np.log(p_limb(0.0)), rtol=1e-12)


def test_arm_behind_the_torso_is_hidden():
    body, samples = arm_before_torso(-0.3), regular_samples(200, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")[0]
    expected = np.abs(samples[:, 0] - 0.5) < 0.3 * shadow(-0.3)  # the arm is 1 m long, the torso 0.6 m
    assert 20 < expected.sum() < 180
    np.testing.assert_array_equal(hidden[1], expected)
    assert not hidden[0].any()


@pytest.mark.parametrize(("distance", "hides"), [(0.119, False), (0.121, True)])
def test_limbs_closer_than_half_the_sum_of_their_radii_do_not_hide_each_other(distance, hides):
    body, samples = arm_before_torso(distance), regular_samples(100, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "sample")
    assert hidden.any() == hides


def test_limb_rule_silences_all_of_the_farther_limb():
    both = log_prob(arm_before_torso(0.3), 128, scenes.root(), occlusion="limb")
    np.testing.assert_allclose(both, np.log(P_OCCLUDED) + np.log(p_limb(0.0)), rtol=1e-12)


def test_limb_rule_orders_limbs_by_their_nearest_surface():
    """The thin rod's axis is nearer by 0.1 m, but the broad one's surface, 0.2 m from its axis, is nearer still."""
    body, samples = arm_before_torso(0.1), regular_samples(100, np.random.default_rng(0))
    hidden = hidden_samples(body.limbs, patches(body, scenes.root()), samples, "limb")[0]
    assert hidden[1].all()
    assert not hidden[0].any()


def test_without_occlusion_nothing_is_hidden():
    both = log_prob(arm_before_torso(0.3), 128, scenes.root(), occlusion="none")
    np.testing.assert_allclose(both, 2 * np.log(p_limb(0.0)), rtol=1e-12)


def test_sphere_hides_a_disc():
    body = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.2), ((0.5, 0.05, 0.02), (0.5, 0.05, 0.02), 0.12))
    samples = regular_samples(300, np.random.default_rng(0))
    found = patches(body, scenes.root())
    hidden = hidden_samples(body.limbs, found, samples, "sample")[0, 0]
    ratio = scenes.FOCAL / (scenes.DISTANCE - 0.5)
    centre = np.array([(scenes.WIDTH - 1) / 2 + 0.05 * ratio, (scenes.HEIGHT - 1) / 2 - 0.02 * ratio])
    distances = np.linalg.norm(found.positions(samples)[0, 0] - centre, axis=1)
    expected = distances < 0.12 * ratio
    # off the optical axis the patch faces the eye and not the image plane: leave out points within 1 % of the rim
    clear = np.abs(distances / (0.12 * ratio) - 1.0) > 0.01
    assert 20 < expected.sum() < 200
    np.testing.assert_array_equal(hidden[clear], expected[clear])


def test_points_outside_the_image_lower_the_visible_fraction():
    """The rod's lower part hangs below the picture: y = 119.5 + 75 (0.3 − 0.6 u + 1.5) px must stay below 239."""
    likelihood = ImageMotion(ROD, sigma=SIGMA, n_samples=N)
    frames = [scenes.frame(i, (scenes.FRONT, scenes.flat(128))) for i in range(2)]
    pose = scenes.root((0.0, 0.0, -1.5))
    inside = 119.5 + 75.0 * (0.3 - 0.6 * likelihood.samples[:, 0] + 1.5) < 239.0
    assert 10 < inside.sum() < 40
    frame_likelihood = likelihood.prepare(*frames)
    found, notes = frame_likelihood.evaluate(pose, pose).log_prob, frame_likelihood.evaluate(pose, pose).notes
    np.testing.assert_allclose(found, np.log(p_limb(0.0, visible=inside.mean())), rtol=1e-12)
    share = f"{1 - inside.mean():.0%}"
    assert notes == (f"image motion: {share} of the sample points lay outside the images of front",)
    # a point outside in either frame is not compared
    np.testing.assert_array_equal(frame_likelihood.evaluate(pose, scenes.root()).log_prob, found)
    np.testing.assert_array_equal(frame_likelihood.evaluate(scenes.root(), pose).log_prob, found)


@pytest.mark.parametrize(("exponent", "n"), [("mean", lambda compared: 1), ("sum", lambda compared: compared)])
def test_only_the_points_compared_enter_the_exponent(exponent, n):
    """A rod half below the picture while everything brightens: the mean, or sum, is over what is seen of it."""
    pose = scenes.root((0.0, 0.0, -1.5))
    inside = 119.5 + 75.0 * (1.8 - 0.6 * ImageMotion(ROD, n_samples=N).samples[:, 0]) < 239.0
    found = log_prob(ROD, 128 + 7, pose, reduction=exponent)
    expected = np.log(p_limb(0.0, 7.0, visible=inside.mean(), n=n(inside.sum())))
    np.testing.assert_allclose(found, expected, atol=50 * 7.0 * GREY / SIGMA**2)


def test_smoothing_is_a_gaussian_of_the_grey_levels():
    rgb = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    grey = rgb @ np.array([0.299, 0.587, 0.114])  # Rec. 601
    expected = gaussian_filter(grey, np.sqrt(2.0), mode="mirror")
    np.testing.assert_allclose(grey_levels(View(scenes.FRONT, rgb), np.sqrt(2.0)), expected, atol=1e-3)


def test_samples_are_spread_evenly():
    samples = regular_samples(50, np.random.default_rng(0))
    assert samples.shape == (50, 2)
    for column, (low, high) in zip(samples.T, ((0.08, 0.92), (-0.8, 0.8)), strict=True):
        counts, _ = np.histogram(column, bins=10, range=(low, high))
        assert counts.sum() == 50
        assert counts.min() >= 3  # independent uniform draws leave a strip with fewer than 3 of 5 seven times in ten


def test_samples_as_in_the_paper_are_uniform_over_the_whole_patch():
    samples = random_samples(20_000, np.random.default_rng(0))
    for column, (low, high) in zip(samples.T, ((0.0, 1.0), (-1.0, 1.0)), strict=True):
        assert kstest(column, "uniform", (low, high - low)).pvalue > 0.01
    assert abs(np.corrcoef(samples.T)[0, 1]) < 0.03


def test_without_taper_a_limb_is_compared_as_the_cylinder_of_its_mean_radius():
    """A cone as wide on average as the rod, before a texture that moves."""
    cone = replace(ROD, limbs=replace(ROD.limbs, radii=np.array([[[0.02, 0.02], [0.08, 0.08]]])))
    texture = scenes.texture(np.random.default_rng(0), scenes.FRONT.width, scenes.FRONT.height)
    frames = [scenes.frame(0, (scenes.FRONT, texture)), scenes.frame(1, (scenes.FRONT, np.roll(texture, 2, axis=1)))]
    pose = scenes.root()
    found, expected, tapered = (
        scenes.log_prob(ImageMotion(body, taper=taper), *frames, pose, pose)
        for body, taper in ((cone, False), (ROD, True), (cone, True))
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert abs(tapered - expected) > 1e-3
