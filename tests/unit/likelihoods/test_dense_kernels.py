"""The kernels of dense alignment against NumPy and SciPy."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from tests.oracles import alignment as oracle
from workbench.body.kinematics import forward, world_axes
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.likelihoods.dense.background_model import BackgroundModel
from workbench.likelihoods.dense.surface_elements import (
    contour_samples,
    dof_mask,
    point_motion,
    project_elements,
    surface_elements,
    visible_elements,
)
from workbench.likelihoods.dense.view_likelihood import (
    SUBSAMPLING,
    Residuals,
    ViewLikelihood,
    interpolate,
    smoothed_image,
    smoothing_pyramids,
)

BODY = person(from_height(1.75))
FAR = plain_camera(320, 240, 330.0, (3.2, -0.9, 0.9), (0.0, 0.0, 0.9))
CAMERAS = {
    "far": FAR,
    "distorted": replace(FAR, distortion=np.array([-0.2, 0.1, 0.01, -0.02, 0.05])),
    "inside the body": plain_camera(320, 240, 200.0, (0.15, 0.1, 0.9), (-3.0, 0.0, 0.9)),
}
SHAPE = (240, 320)
ELEMENTS = surface_elements(BODY.limbs)


def random_pose(seed):
    pose = 0.3 * np.random.default_rng(seed).standard_normal(25)
    pose[:3] += 0.0, 0.0, 0.95
    return pose, forward(BODY.skeleton, pose[None])


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(3))
def test_projected_and_visible_elements_are_those_of_numpy(name, seed):
    frames, camera = random_pose(seed)[1], CAMERAS[name]
    projected, expected = project_elements(ELEMENTS, frames, camera), oracle.project_elements(ELEMENTS, frames, camera)
    for key in ("points", "facing", "depth", "pixels"):
        np.testing.assert_allclose(getattr(projected, key), getattr(expected, key), rtol=1e-9, atol=1e-9)
    assert np.isnan(expected.pixels).any() == (name == "inside the body")
    for facing in (0.0, 0.3):
        visible = visible_elements(expected, SHAPE, facing)
        np.testing.assert_array_equal(visible, oracle.visible_elements(expected, SHAPE, facing))
        assert len(visible) < len(ELEMENTS.joints)
        assert len(visible) > 0 or name == "inside the body"


@pytest.mark.parametrize("seed", range(3))
def test_axes_of_point_motion_are_those_of_the_kinematics(seed):
    pose, frames = random_pose(seed)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames)
    axes = world_axes(BODY.skeleton, pose[None], frames)[0]
    np.testing.assert_allclose(motion.axes, axes, atol=1e-12)
    moments = np.cross(axes, frames.positions[0][BODY.skeleton.dof_joints])
    np.testing.assert_allclose(motion.moments, moments, atol=1e-12)


@pytest.mark.parametrize("name", ["far", "distorted"])
def test_contour_samples_are_those_of_numpy(name):
    frames = random_pose(1)[1]
    samples, expected = (
        sample(BODY.limbs, frames, CAMERAS[name], (0.8, 4.0)) for sample in (contour_samples, oracle.contour_samples)
    )
    (points, joints, pixels), (true_points, true_joints, true_pixels) = samples, expected
    np.testing.assert_allclose(points, true_points, atol=1e-12)
    np.testing.assert_allclose(pixels, true_pixels, atol=1e-9)
    np.testing.assert_array_equal(joints, true_joints)


@pytest.mark.parametrize("loss_scale", [2.0, 10.0])
def test_normal_equations_are_those_of_numpy(loss_scale):
    rng, (pose, frames) = np.random.default_rng(0), random_pose(2)
    motion, n = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames), len(ELEMENTS.joints)
    residuals = Residuals(
        3.0 * rng.standard_normal(n), rng.standard_normal((n, 2)),
        project_elements(ELEMENTS, frames, FAR).points, ELEMENTS.joints,
        rng.integers(0, 2, n).astype(np.float64), loss_scale,
    )  # fmt: skip
    pairs = zip(residuals.normal_equations(motion, FAR), oracle.normal(residuals, motion, FAR), strict=True)
    for computed, expected in pairs:
        np.testing.assert_allclose(computed, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_interpolated_values_and_gradients_are_those_of_scipy():
    rng = np.random.default_rng(0)
    image = smoothed_image((255.0 * rng.random((50, 70))).astype(np.float32), 1.2)
    pixels = np.column_stack([rng.uniform(2.0, 66.9, 300), rng.uniform(2.0, 46.9, 300)])
    pixels[:20] = np.rint(pixels[:20])
    for computed, expected in zip(interpolate(image, pixels), oracle.interpolated(image, pixels), strict=True):
        np.testing.assert_allclose(computed, expected, atol=1e-9)


def partly_observed_background():
    rng = np.random.default_rng(0)
    n = np.where(rng.random((100, 80)) < 0.3, 0.0, rng.integers(1, 25, (100, 80)))
    return BackgroundModel(255.0 * rng.random((100, 80)), n, 4.0)


@pytest.mark.parametrize("threads", [1, 2])
def test_the_background_model_is_compared_and_updated_as_in_numpy(threads, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    rng, model = np.random.default_rng(1), partly_observed_background()
    image = (model.level + 12.0 * rng.standard_normal(model.level.shape)).astype(np.float32)
    expected = oracle.background_log_ratio(model, image, 0.05)
    np.testing.assert_allclose(model.log_ratio(image, 0.05), expected, rtol=1e-5, atol=1e-5)
    covered, level_before = rng.random(model.level.shape) < 0.001, model.level.copy()
    updated, expected_update = model.updated(image, covered), oracle.updated_background(model, image, covered)
    np.testing.assert_array_equal(updated.n, expected_update.n)
    np.testing.assert_allclose(updated.level, expected_update.level, rtol=1e-12)
    assert (updated.n > model.n).any()
    np.testing.assert_array_equal(model.level, level_before)


def test_smoothing_does_not_depend_on_the_number_of_threads(monkeypatch):
    images = [(255.0 * np.random.default_rng(k).random((60, 80))).astype(np.float32) for k in range(2)]
    for threads in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        for image, levels in zip(images, smoothing_pyramids(images, (6.0, 1.2)), strict=True):
            for blur, level in zip((6.0, 1.2), levels, strict=True):
                np.testing.assert_array_equal(level, smoothed_image(image, blur))


def test_the_subsampled_view_agrees_with_its_camera():
    image = (255.0 * np.random.default_rng(0).random(SHAPE)).astype(np.float32)
    all_pixels = np.ones(SHAPE, dtype=bool)
    pyramid = (smoothed_image(image, 1.2),)
    view_likelihood = ViewLikelihood(CAMERAS["distorted"], pyramid, (), all_pixels, all_pixels, image)
    camera, levels, ratio, free = view_likelihood.subsampled
    point = np.array([0.1, 0.2, 1.1])
    np.testing.assert_allclose(SUBSAMPLING * camera.project(point), view_likelihood.camera.project(point))
    assert levels.shape == ratio.shape == free.shape == (camera.height, camera.width)
    assert levels[7, 9] == view_likelihood.pyramid[-1][7 * SUBSAMPLING, 9 * SUBSAMPLING]
