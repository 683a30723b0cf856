"""The alignment's kernels against the same in NumPy."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from tests.oracles import alignment as oracle
from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward, world_axes
from workbench.body.limbs import person
from workbench.body.shape import from_height
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
    "bent": replace(FAR, distortion=np.array([-0.2, 0.1, 0.01, -0.02, 0.05])),
    "among the limbs": plain_camera(320, 240, 200.0, (0.15, 0.1, 0.9), (-3.0, 0.0, 0.9)),
}
SHAPE = (240, 320)
CELLS = surface_elements(BODY.limbs)


def walking(seed):
    pose = 0.3 * np.random.default_rng(seed).standard_normal(25)
    pose[:3] += 0.0, 0.0, 0.95
    return pose, forward(BODY.skeleton, pose[None])


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(3))
def test_cells_are_placed_and_seen_as_in_numpy(name, seed):
    frames, camera = walking(seed)[1], CAMERAS[name]
    found, expected = project_elements(CELLS, frames, camera), oracle.project_elements(CELLS, frames, camera)
    for key in ("points", "facing", "depth", "pixels"):
        np.testing.assert_allclose(getattr(found, key), getattr(expected, key), rtol=1e-9, atol=1e-9)
    assert np.isnan(expected.pixels).any() == (name == "among the limbs")
    for facing in (0.0, 0.3):
        seen = visible_elements(expected, SHAPE, facing)
        np.testing.assert_array_equal(seen, oracle.visible_elements(expected, SHAPE, facing))
        assert len(seen) < len(CELLS.joints)
        assert len(seen) > 0 or name == "among the limbs"


@pytest.mark.parametrize("seed", range(3))
def test_axes_are_those_of_kinematics(seed):
    pose, frames = walking(seed)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames)
    axes = world_axes(BODY.skeleton, pose[None], frames)[0]
    np.testing.assert_allclose(motion.axes, axes, atol=1e-12)
    np.testing.assert_allclose(
        motion.moments, np.cross(axes, frames.positions[0][BODY.skeleton.dof_joints]), atol=1e-12
    )


@pytest.mark.parametrize("name", ["far", "bent"])
def test_points_beside_limbs_are_those_of_numpy(name):
    frames = walking(1)[1]
    found, expected = (
        way(BODY.limbs, frames, CAMERAS[name], (0.8, 4.0)) for way in (contour_samples, oracle.contour_samples)
    )
    (points, joints, pixels), (true_points, true_joints, true_pixels) = found, expected
    np.testing.assert_allclose(points, true_points, atol=1e-12)
    np.testing.assert_allclose(pixels, true_pixels, atol=1e-9)
    np.testing.assert_array_equal(joints, true_joints)


@pytest.mark.parametrize("bend", [2.0, 10.0])
def test_normal_equations_are_those_of_numpy(bend):
    rng, (pose, frames) = np.random.default_rng(0), walking(2)
    motion, n = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames), len(CELLS.joints)
    residuals = Residuals(
        3.0 * rng.standard_normal(n), rng.standard_normal((n, 2)),
        project_elements(CELLS, frames, FAR).points, CELLS.joints,
        rng.integers(0, 2, n).astype(np.float64), bend,
    )  # fmt: skip
    for found, expected in zip(
        residuals.normal_equations(motion, FAR), oracle.normal(residuals, motion, FAR), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_values_and_slopes_between_pixels_are_those_of_scipy():
    rng = np.random.default_rng(0)
    shown = smoothed_image((255.0 * rng.random((50, 70))).astype(np.float32), 1.2)
    pixels = np.column_stack([rng.uniform(2.0, 66.9, 300), rng.uniform(2.0, 46.9, 300)])
    pixels[:20] = np.rint(pixels[:20])
    for found, expected in zip(interpolate(shown, pixels), oracle.interpolated(shown, pixels), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)


def half_known(seed=0):
    rng = np.random.default_rng(seed)
    n = np.where(rng.random((100, 80)) < 0.3, 0.0, rng.integers(1, 25, (100, 80)))
    return BackgroundModel(255.0 * rng.random((100, 80)), n, 4.0)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_scene_is_compared_and_learned_as_in_numpy(threads, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    rng, scene = np.random.default_rng(1), half_known()
    image = (scene.level + 12.0 * rng.standard_normal(scene.level.shape)).astype(np.float32)
    expected = oracle.background_log_ratio(scene, image, 0.05)
    np.testing.assert_allclose(scene.log_ratio(image, 0.05), expected, rtol=1e-5, atol=1e-5)
    covered, before = rng.random(scene.level.shape) < 0.001, scene.level.copy()
    found, learned = scene.updated(image, covered), oracle.updated_background(scene, image, covered)
    np.testing.assert_array_equal(found.n, learned.n)
    np.testing.assert_allclose(found.level, learned.level, rtol=1e-12)
    assert (found.n > scene.n).any()
    np.testing.assert_array_equal(scene.level, before)


def test_images_are_smoothed_alike_on_any_number_of_threads(monkeypatch):
    images = [(255.0 * np.random.default_rng(k).random((60, 80))).astype(np.float32) for k in range(2)]
    for threads in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        for image, levels in zip(images, smoothing_pyramids(images, (6.0, 1.2)), strict=True):
            for blur, level in zip((6.0, 1.2), levels, strict=True):
                np.testing.assert_array_equal(level, smoothed_image(image, blur))


def test_what_is_thinned_lies_where_its_camera_sees_it():
    image = (255.0 * np.random.default_rng(0).random(SHAPE)).astype(np.float32)
    everywhere = np.ones(SHAPE, dtype=bool)
    sight = ViewLikelihood(CAMERAS["bent"], (smoothed_image(image, 1.2),), (), everywhere, everywhere, image)
    camera, levels, ratio, free = sight.subsampled
    point = np.array([0.1, 0.2, 1.1])
    np.testing.assert_allclose(SUBSAMPLING * camera.project(point), sight.camera.project(point))
    assert levels.shape == ratio.shape == free.shape == (camera.height, camera.width)
    assert levels[7, 9] == sight.pyramid[-1][7 * SUBSAMPLING, 9 * SUBSAMPLING]
