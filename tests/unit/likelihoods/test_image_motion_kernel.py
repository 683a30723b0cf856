"""The image-motion kernel against its NumPy reference."""

import likelihood_scenes as scenes
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from analysis.benchmarks.likelihood import packed_lookups
from tests.oracles import image_motion as oracle
from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.simd_kinematics import LANES
from workbench.cameras.camera import plain_camera
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.image_motion import BLUR_PX, ImageMotion
from workbench.likelihoods.image_motion.kernel import GREY_STEP, PARENT_BLOCK, PackedView, packed, view_log_prob


def tolerance(likelihood):
    """Return three standard deviations of the log likelihood's error due to the rounding of grey levels.

    Levels are rounded to 255/65535, so that a difference of two has independent errors of at most δ = (255/65535)/√6.
    The error of the exponent k/n Σ r² / 2σ² is k/n √(Σ r²) δ / σ². The outlier density bounds the effect of exponents
    above 10, where √(Σ r²) = √(20 n/k) σ; 12 limbs have √12 times this error. For the sum of n points, n is 1.
    """
    k = likelihood.effective_pixels / (1 if likelihood.reduction == "sum" else likelihood.n_samples)
    return 3.0 * np.sqrt(12 * 20 * k / 6) * GREY_STEP / likelihood.sigma


ROLL = np.array([[-0.6, 0.8, 0.0], [-0.8, -0.6, 0.0], [0.0, 0.0, 1.0]])  # by 127°: people lie on their heads
CAMERAS = {
    "front": scenes.FRONT,
    "distorted": scenes.distorted(scenes.FRONT),
    "close and oblique": plain_camera(320, 240, 250.0, (1.6, 1.1, 1.0), (0.0, 0.0, 0.1), name="close").turned(
        ROLL, 1.0
    ),
    "cut off": plain_camera(320, 240, 300.0, (4.0, 0.0, 0.0), (0.0, 2.1, 1.0), name="cut off"),
}


def scene(camera, n, seed=1):
    rng = np.random.default_rng(seed)
    before = scenes.texture(rng, camera.width, camera.height)
    noise = rng.normal(0.0, 4.0, before.shape)
    now = np.clip(before.astype(float) + noise, 0, 255).astype(np.uint8)
    poses = scenes.people(rng, n)
    row = np.arange(n)
    poses = poses[np.where(row // LANES % 2, row // LANES * LANES, row)]  # every second chunk has equal lanes
    poses[0, 0] = 5.0  # behind the first camera, in front of none
    frames = scenes.frame(0, (camera, before)), scenes.frame(1, (camera, now))
    return *frames, poses, poses + 0.01 * rng.standard_normal()


def reference_and_kernel(likelihood, previous, frame, previous_poses, poses):
    body, posed, packed_views = likelihood.body, [], []
    for f, p in ((previous, previous_poses), (frame, poses)):
        camera, image = f.views[0].camera, grey_levels(f.views[0], BLUR_PX)
        posed.append(oracle.PosedView(camera, image, forward_oracle(body.skeleton, p)))
        packed_views.append(PackedView(camera, packed(image), p))
    constants = likelihood.samples, likelihood.model
    expected = oracle.view_log_prob(body.limbs, *constants, *posed)
    return expected, view_log_prob(body, *constants, *packed_views)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("reduction", ["mean", "sum"])
@pytest.mark.parametrize("occlusion", ["sample", "limb", "none"])
def test_the_kernel_agrees_with_the_reference(camera, reduction, occlusion):
    likelihood = ImageMotion(scenes.PERSON, reduction=reduction, occlusion=occlusion, effective_pixels=1.5)
    (expected, outside), (values, values_outside) = reference_and_kernel(likelihood, *scene(camera, 60))
    assert expected.std() > 1.0  # the likelihood depends on the pose
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=tolerance(likelihood))
    np.testing.assert_array_equal(values_outside, outside)


@pytest.mark.parametrize(
    "options",
    [
        {"outlier_fraction": 0.0},
        {"background": "static"},
        {"background": "static", "reduction": "sum", "occlusion": "limb", "n_samples": 10},
        {"background": "static", "outlier_fraction": 0.0},
        {"sigma": 2.0},
        {"reduction": "sum", "occlusion": "limb", "sampling": "random"},
        {"n_samples": 1},
        {"n_samples": 37},
    ],
    ids=str,
)
def test_the_kernel_agrees_with_the_reference_for_other_options(options):
    likelihood = ImageMotion(scenes.PERSON, **options)
    (expected, _), (values, _) = reference_and_kernel(likelihood, *scene(CAMERAS["close and oblique"], 60))
    factor = 2.0 if likelihood.background == "static" else 1.0  # a static background is a second term
    if likelihood.outlier_fraction == 0.0:  # √(Σ r²) may be √n · 100 grey levels instead of √(20 n/k) σ
        factor *= 100.0 / likelihood.sigma / np.sqrt(20.0 / likelihood.effective_pixels)
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=factor * tolerance(likelihood))


def test_the_kernel_agrees_with_the_reference_for_images_of_two_sizes():
    likelihood, zoomed = ImageMotion(scenes.PERSON), scenes.FRONT.scaled(1.5)
    previous, _, previous_poses, poses = scene(scenes.FRONT, 40)
    frame = scenes.frame(1, (zoomed, scenes.texture(np.random.default_rng(3), zoomed.width, zoomed.height)))
    (expected, outside), (values, values_outside) = reference_and_kernel(
        likelihood, previous, frame, previous_poses, poses
    )
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=tolerance(likelihood))
    np.testing.assert_array_equal(values_outside, outside)


def test_packed_words_contain_a_pixel_and_its_neighbours():
    image = np.random.default_rng(0).uniform(0.0, 255.0, (7, 9)).astype(np.float32)
    words = packed(image)
    padded = np.pad(image, ((0, 1), (0, 1)), "edge")
    for shift, rows, columns in ((0, 0, 0), (16, 0, 1), (32, 1, 0), (48, 1, 1)):
        levels = (words >> np.uint64(shift) & np.uint64(0xFFFF)) * GREY_STEP
        expected = padded[rows : rows + 7, columns : columns + 9]
        np.testing.assert_allclose(levels, expected, rtol=0.0, atol=0.5001 * GREY_STEP)


def test_the_scenes_include_occlusion_points_outside_and_limbs_without_a_patch():
    likelihood = ImageMotion(scenes.PERSON)
    limbs = scenes.PERSON.limbs
    for name, camera in CAMERAS.items():
        previous, _, poses, _ = scene(camera, 60)
        image = grey_levels(previous.views[0], 0.0)
        view = oracle.PosedView(camera, image, forward_oracle(scenes.PERSON.skeleton, poses))
        patches = oracle.limb_patches(limbs, view)
        hidden = oracle.hidden_samples(limbs, patches, likelihood.samples, "sample")
        inside = oracle.inside_image(image, patches.positions(likelihood.samples))
        assert 0.02 < hidden.mean() < 0.5, name
        assert hidden[:, ~limbs.spheres].any()
        assert hidden[:, limbs.spheres].any()
        if name == "cut off":
            assert 0.2 < inside.mean() < 0.8
        if name in ("front", "distorted"):
            assert (patches.cos_alpha[0] == 0.0).all()
            assert (patches.cos_alpha[1:] > 0.0).all()


@pytest.mark.parametrize("camera", ["front", "cut off"])
def test_sharing_the_previous_pose_changes_no_bit(camera):
    """Runs of equal previous poses of all lengths cross the borders of blocks."""
    likelihood, n = ImageMotion(scenes.PERSON), 2 * PARENT_BLOCK + 7
    previous, frame, previous_poses, poses = scene(CAMERAS[camera], n)
    lengths = np.random.default_rng(0).integers(1, 40, n)
    shared = np.repeat(previous_poses, lengths, axis=0)[:n]
    grouped = scenes.log_prob(likelihood, previous, frame, shared, poses)
    order = np.random.default_rng(1).permutation(n)
    separate = np.empty(n)
    separate[order] = scenes.log_prob(likelihood, previous, frame, shared[order], poses[order])
    np.testing.assert_array_equal(grouped, separate)
    assert len(np.unique(grouped)) > n / 2


HEIGHT, WIDTH, N = 37, 53, 400


def test_interpolation_of_packed_levels_agrees_with_scipy():
    rng = np.random.default_rng(0)
    image = rng.uniform(0.0, 255.0, (HEIGHT, WIDTH)).astype(np.float32)
    x, y = (rng.uniform(0.0, size - 1.001, N).astype(np.float32) for size in (WIDTH, HEIGHT))
    expected = map_coordinates(image.astype(float), [y, x], order=1).sum()
    # rounding errors are independent with a standard deviation of 1/√12 of a step
    deviations = 6.0 * np.sqrt(N / 12.0)
    assert packed_lookups(packed(image), x, y) * GREY_STEP == pytest.approx(expected, abs=deviations * GREY_STEP + 0.01)
