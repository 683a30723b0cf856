"""Stereo: disparities of shifted images, the projection of the room, and points of a rendered pair."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from workbench.cameras.camera import plain_camera
from workbench.datasets import stereo as stereo_module
from workbench.datasets.rendering.surroundings import empty_view, room
from workbench.datasets.rendering.visible import surface_points
from workbench.datasets.stereo import Stereo, disparities, empty_disparity, foreground_points

SMALL = {"n_frames": 2, "width": 320, "height": 240, "focal_px": 350.0, "baseline_m": 0.4, "n_points": 300}


@pytest.fixture(scope="module")
def dataset():
    return Stereo(**SMALL)


@pytest.fixture(scope="module")
def cached(dataset, tmp_path_factory):
    """The same dataset with a cache of images, made by one thread."""
    cached = replace(dataset, cache=str(tmp_path_factory.mktemp("cache")))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        next(cached.frames())
    finally:
        cv2.setNumThreads(threads)
    return cached


def texture(seed, shape=(60, 300)):
    noise = np.random.default_rng(seed).standard_normal(shape)
    return np.clip(125 + 120 * cv2.GaussianBlur(noise, (0, 0), 1.2), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift", [3, 9, 14])
def test_the_disparity_of_a_shifted_image_is_the_shift(shift):
    image = texture(shift)
    left, right = image[:, :-20], np.roll(image, -shift, axis=1)[:, :-20]
    estimated = disparities(left, right, 16)
    assert estimated.shape == left.shape
    assert np.isnan(estimated[:, : shift - 1]).mean() > 0.9  # outside of the right image
    inner = estimated[5:-5, 20:-20]
    assert np.isfinite(inner).mean() > 0.95
    # the matcher rounds to 1/16 px, and its parabola fit has a bias of a few of them
    assert np.abs(inner[np.isfinite(inner)] - shift).max() < 0.25


def test_disparities_above_those_of_the_background_become_points():
    camera, baseline = plain_camera(80, 60, 100.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0)), 0.5
    empty, disparity = np.full((60, 80), 10.0), np.full((60, 80), 10.0)
    disparity[10:40, 20:40], disparity[50:52, 60:62] = 12.5, 14.0  # a person of 600 px, and a patch of 4 px
    disparity[10:12, 20:40], disparity[12:14, 20:40] = np.nan, 11.9  # unknown, and less than 2 px above the background
    empty[14:16, 20:40] = np.nan
    points = foreground_points(disparity, empty, camera, baseline)
    assert len(points) == 24 * 20
    in_camera = camera.to_camera(points)
    assert np.allclose(in_camera[:, 2], 100.0 * 0.5 / 12.5)
    pixels = camera.project(points)
    assert np.allclose(pixels, np.round(pixels))
    assert (pixels.min(axis=0), pixels.max(axis=0)) == (pytest.approx([20, 16]), pytest.approx([39, 39]))
    right = replace(camera, translation=camera.translation - [baseline, 0.0, 0.0])
    assert np.allclose(pixels - right.project(points), [12.5, 0.0])
    assert foreground_points(empty, empty, camera, baseline).shape == (0, 3)


def test_the_background_disparity_is_the_largest_observed():
    pairs = np.array([[[1.0, np.nan, 3.0]], [[2.0, np.nan, np.nan]], [[1.5, 4.0, np.nan]]])
    assert np.array_equal(empty_disparity(pairs), [[2.0, np.nan, np.nan]], equal_nan=True)


@pytest.mark.parametrize("surface", ["wall", "floor"])
def test_textures_of_the_room_are_projected(dataset, surface):
    """A white spot of 11 × 11 texels lies 40 cm to the right and 60 cm up the wall or along the floor."""
    camera = dataset.cameras[0]
    room_of_scene = room(dataset.sequence, camera, np.random.default_rng(0), clutter=0.0)
    spot_texture = np.zeros(getattr(room_of_scene, surface).shape)
    column = spot_texture.shape[1] // 2 + 40
    spot_texture[55:66, column - 5 : column + 6] = 255.0
    textures = {"wall": np.zeros((500, 1600)), "floor": np.zeros((1200, 1600)), surface: spot_texture}
    view = empty_view(replace(room_of_scene, **textures), camera)
    rows, columns = np.indices(view.shape)
    centre = [(view * columns).sum() / view.sum(), (view * rows).sum() / view.sum()]
    direction = [0.0, 0.0, 1.0] if surface == "wall" else -room_of_scene.forward
    spot = room_of_scene.origin + 0.4 * room_of_scene.right + 0.6 * np.asarray(direction)
    assert centre == pytest.approx(camera.project(spot), abs=0.3)  # the centroid's bias by perspective is smaller


def test_frames_have_both_images_and_points_near_the_surface(dataset):
    for frame in dataset.frames():
        assert [view.camera.name for view in frame.views] == ["left", "right"]
        assert frame.views[0].image.shape == (240, 320)
        assert frame.points.shape == (300, 3)
        assert frame.truth.activity == "walk"
        surface = surface_points(dataset.sequence.body, frame.truth.pose, 20000, np.random.default_rng(0))
        distances, _ = KDTree(surface).query(frame.points)
        # 1 px of disparity is z² / (f b) = 11 cm of depth; most points have errors below half a pixel
        assert np.median(distances) < 0.055
        assert np.quantile(distances, 0.8) < 0.11


def test_the_right_camera_is_shifted_by_the_baseline(dataset):
    left, right = dataset.cameras
    assert np.allclose(left.rotation @ (right.position - left.position), [0.4, 0.0, 0.0])
    rows = [camera.project(dataset.sequence.places)[..., 1] for camera in (left, right)]
    assert np.allclose(*rows)


def test_cached_points_are_identical_and_not_rendered_again(dataset, cached, monkeypatch):
    assert len(list(Path(cached.cache).rglob("*.npz"))) == 1

    def fail(*_):
        raise AssertionError("rendered again")

    monkeypatch.setattr(stereo_module.render, "render", fail)
    read = replace(cached)
    assert all(np.array_equal(a.points, b.points) for a, b in zip(dataset.frames(), read.frames(), strict=True))
    fewer_points = replace(cached, n_points=50, initialization="perturbed_truth")  # neither changes the images
    assert len(next(fewer_points.frames()).points) == 50
    with pytest.raises(AssertionError, match="rendered again"):
        next(replace(cached, seed=1).frames())
