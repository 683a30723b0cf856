"""The fused kernel against its NumPy reference, and the same bits whatever the number of threads."""

import likelihood_scenes as scenes
import numba
import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward_reference
from workbench.likelihoods import image_motion_kernel, image_motion_reference
from workbench.likelihoods.image_motion import ImageMotion, smoothed

# float32 holds a grey level to 255 · 2⁻²⁴ = 1.5e-5 and an interpolation adds a few of those: residuals are good to
# δ = 1e-4. With residuals r of σ = 6 grey levels, 12 limbs move by 12 r δ / σ² = 2e-4 at most in the mean over the
# points; their sum counts √50 to 50 of them, but a limb with Σ r² / 2σ² above 10 sits on its floor, which caps it.
TOLERANCE = {"mean": 2e-4, "sum": 2e-3}

CAMERAS = {
    "front": scenes.FRONT,
    "distorted": scenes.distorted(scenes.FRONT),
    "close and oblique": plain_camera(320, 240, 250.0, (1.6, 1.1, 1.0), (0.0, 0.0, 0.1), name="close"),
    "cut off": plain_camera(320, 240, 300.0, (4.0, 0.0, 0.0), (0.0, 2.1, 1.0), name="cut off"),
}


def scene(camera, n, seed=1):
    rng = np.random.default_rng(seed)
    before = scenes.texture(rng, camera.width, camera.height)
    noise = rng.normal(0.0, 4.0, before.shape)
    now = np.clip(before.astype(float) + noise, 0, 255).astype(np.uint8)
    poses = scenes.people(rng, n)
    poses[0, 0] = 5.0  # behind the first camera, in front of none
    return (
        scenes.frame(0, (camera, before)),
        scenes.frame(1, (camera, now)),
        poses,
        poses + 0.01 * rng.standard_normal(),
    )


def by_reference(likelihood, previous, frame, previous_poses, poses):
    skeleton = likelihood.body.skeleton
    before, now = (
        image_motion_kernel.PosedView(
            f.views[0].camera, smoothed(f.views[0], likelihood.blur_px), forward_reference(skeleton, p)
        )
        for f, p in ((previous, previous_poses), (frame, poses))
    )
    arguments = (likelihood.body.limbs, likelihood.samples, likelihood.model, before, now)
    return image_motion_reference.view_log_prob(*arguments), image_motion_kernel.view_log_prob(*arguments)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("exponent", ["mean", "sum"])
@pytest.mark.parametrize("occlusion", ["sample", "limb", "none"])
def test_kernel_agrees_with_the_reference(camera, exponent, occlusion):
    likelihood = ImageMotion(scenes.PERSON, exponent=exponent, occlusion=occlusion, k=1.5)
    (expected, outside), (found, found_outside) = by_reference(likelihood, *scene(camera, 60))
    assert expected.std() > 1.0  # the scene tells poses apart, or the comparison would say little
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE[exponent])
    np.testing.assert_array_equal(found_outside, outside)


@pytest.mark.parametrize(
    "options",
    [
        {"epsilon": 0.0},
        {"background": "still"},
        {"background": "still", "exponent": "sum", "occlusion": "limb", "n_samples": 10},
        {"background": "still", "epsilon": 0.0},
        {"sigma": 2.0, "p_occluded": 1e-4},
        {"n_samples": 1},
        {"n_samples": 37, "blur_px": 0.0, "seed": 5},
    ],
    ids=str,
)
def test_kernel_agrees_with_the_reference_for_other_constants(options):
    likelihood = ImageMotion(scenes.PERSON, **options)
    (expected, _), (found, _) = by_reference(likelihood, *scene(CAMERAS["close and oblique"], 60))
    # without a floor under the Gaussian a residual of r moves the logarithm by r δ / σ², here up to 100 · 1e-4 / 4
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=12 * 100.0 * 1e-4 / likelihood.sigma**2)


def test_the_scenes_hold_what_they_should():
    """Hidden points, points outside, limbs without a patch: else the comparisons above would leave them out."""
    likelihood = ImageMotion(scenes.PERSON)
    limbs = scenes.PERSON.limbs
    for name, camera in CAMERAS.items():
        previous, _, poses, _ = scene(camera, 60)
        image = smoothed(previous.views[0], 0.0)
        view = image_motion_kernel.PosedView(camera, image, forward_reference(scenes.PERSON.skeleton, poses))
        patches = image_motion_reference.limb_patches(limbs, view)
        hidden = image_motion_reference.hidden_samples(limbs, patches, likelihood.samples, "sample")
        inside = image_motion_reference.inside_image(image, patches.positions(likelihood.samples))
        assert 0.02 < hidden.mean() < 0.5, name
        assert hidden[:, ~limbs.spheres].any()
        assert hidden[:, limbs.spheres].any()
        if name == "cut off":
            assert 0.2 < inside.mean() < 0.8
        if name in ("front", "distorted"):
            assert (patches.cos_alpha[0] == 0.0).all()
            assert (patches.cos_alpha[1:] > 0.0).all()


def test_one_and_two_threads_give_the_same_bits():
    most = numba.config.NUMBA_NUM_THREADS
    if most < 2:
        pytest.skip("numba has one thread only here")
    likelihood = ImageMotion(scenes.PERSON)
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(likelihood.log_prob(*scene(scenes.FRONT, 500)))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0], results[1])
