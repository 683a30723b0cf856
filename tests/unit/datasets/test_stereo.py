"""Stereo: disparities against known shifts, the room against projection, and the points of a rendered pair."""

import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.datasets import stereo as stereo_module
from workbench.datasets.rendering.surroundings import empty_view, room
from workbench.datasets.rendering.visible import surface_points
from workbench.datasets.stereo import Stereo, disparities, empty_disparity, foreground_points

SMALL = {"n_frames": 2, "width": 320, "height": 240, "focal_px": 350.0, "baseline_m": 0.4, "n_points": 300}


@pytest.fixture(scope="module")
def dataset():
    return Stereo(**SMALL)


def texture(seed, shape=(60, 300)):
    noise = np.random.default_rng(seed).standard_normal(shape)
    return np.clip(125 + 120 * cv2.GaussianBlur(noise, (0, 0), 1.2), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift", [3, 9, 14])
def test_the_disparity_of_a_shifted_picture_is_its_shift(shift):
    picture = texture(shift)
    left, right = picture[:, :-20], np.roll(picture, -shift, axis=1)[:, :-20]
    found = disparities(left, right, 16)
    assert found.shape == left.shape
    assert np.isnan(found[:, : shift - 1]).mean() > 0.9  # the right image does not hold it
    known = found[5:-5, 20:-20]
    assert np.isfinite(known).mean() > 0.95
    # a sixteenth of a pixel is the matcher's unit; its fit of a parabola leans by up to a few of them
    assert np.abs(known[np.isfinite(known)] - shift).max() < 0.25


def test_what_is_nearer_than_the_empty_scene_becomes_points_at_its_depth():
    camera, baseline = plain_camera(80, 60, 100.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0)), 0.5
    empty, seen = np.full((60, 80), 10.0), np.full((60, 80), 10.0)
    seen[10:40, 20:40], seen[50:52, 60:62] = 12.5, 14.0  # someone, and a patch of 4 px beside their 600
    seen[10:12, 20:40], seen[12:14, 20:40] = np.nan, 11.9  # unknown, and less than two pixels nearer
    empty[14:16, 20:40] = np.nan
    points = foreground_points(seen, empty, camera, baseline)
    assert len(points) == 24 * 20
    in_camera = camera.to_camera(points)
    assert np.allclose(in_camera[:, 2], 100.0 * 0.5 / 12.5)
    pixels = camera.project(points)
    assert np.allclose(pixels, np.round(pixels))
    assert (pixels.min(axis=0), pixels.max(axis=0)) == (pytest.approx([20, 16]), pytest.approx([39, 39]))
    right = replace(camera, translation=camera.translation - [baseline, 0.0, 0.0])
    assert np.allclose(pixels - right.project(points), [12.5, 0.0])
    assert foreground_points(empty, empty, camera, baseline).shape == (0, 3)


def test_the_empty_scene_is_the_nearest_that_was_seen_of_it():
    pairs = np.array([[[1.0, np.nan, 3.0]], [[2.0, np.nan, np.nan]], [[1.5, 4.0, np.nan]]])
    assert np.array_equal(empty_disparity(pairs), [[2.0, np.nan, np.nan]], equal_nan=True)


@pytest.mark.parametrize("surface", ["wall", "floor"])
def test_the_rooms_pictures_are_seen_where_they_are(dataset, surface):
    """A white spot of 11 × 11 texels, 40 cm to the right and 60 cm up the wall, or out on the floor."""
    camera = dataset.cameras[0]
    place = room(dataset.sequence, camera, np.random.default_rng(0), clutter=0.0)
    picture = np.zeros(getattr(place, surface).shape)
    column = picture.shape[1] // 2 + 40
    picture[55:66, column - 5 : column + 6] = 255.0
    dark = replace(place, **{"wall": np.zeros((500, 1600)), "floor": np.zeros((1200, 1600)), surface: picture})
    view = empty_view(dark, camera)
    rows, columns = np.indices(view.shape)
    centre = [(view * columns).sum() / view.sum(), (view * rows).sum() / view.sum()]
    up = [0.0, 0.0, 1.0] if surface == "wall" else -place.forward
    spot = place.origin + 0.4 * place.right + 0.6 * np.asarray(up)
    assert centre == pytest.approx(camera.project(spot), abs=0.3)  # px; perspective moves a spot's centre less


def test_frames_carry_both_images_and_points_of_the_person(dataset):
    for frame in dataset.frames():
        assert [view.camera.name for view in frame.views] == ["left", "right"]
        assert frame.views[0].image.shape == (240, 320)
        assert frame.points.shape == (300, 3)
        assert frame.truth.activity == "walk"
        surface = surface_points(dataset.sequence.body, frame.truth.pose, 20000, np.random.default_rng(0))
        apart = np.linalg.norm(frame.points[:, None] - surface[None], axis=2).min(axis=1)
        # a pixel of disparity is z² / (f b) = 11 cm of depth here; most points are right to half of one
        assert np.median(apart) < 0.055
        assert np.quantile(apart, 0.8) < 0.11


def test_the_right_camera_stands_a_baseline_to_the_right(dataset):
    left, right = dataset.cameras
    assert np.allclose(left.rotation @ (right.position - left.position), [0.4, 0.0, 0.0])
    rows = [camera.project(dataset.sequence.places)[..., 1] for camera in (left, right)]
    assert np.allclose(*rows)


def test_the_same_seed_gives_the_same_bits_at_any_number_of_threads(dataset):
    first = [frame.points for frame in dataset.frames()]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        again = [frame.points for frame in Stereo(**SMALL).frames()]
    finally:
        cv2.setNumThreads(threads)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_the_cache_gives_the_same_bits_without_rendering(dataset, tmp_path, monkeypatch):
    first = [frame.points for frame in dataset.frames()]
    kept = replace(dataset, cache=str(tmp_path))
    assert all(np.array_equal(a, b.points) for a, b in zip(first, kept.frames(), strict=True))
    assert len(list(tmp_path.rglob("*.npz"))) == 1

    def refuse(*_):
        raise AssertionError("rendered again")

    monkeypatch.setattr(stereo_module.render, "render", refuse)
    assert all(np.array_equal(a, b.points) for a, b in zip(first, replace(kept).frames(), strict=True))
    assert (
        len(next(replace(kept, n_points=50, initialization="perturbed_truth").frames()).points) == 50
    )  # no parameter of the images
    for change in ({"seed": 1}, {"baseline_m": 0.3}, {"noise_std": 3.0}, {"first_frame": 1}, {"motion": "builtin_run"}):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            with pytest.raises(AssertionError, match="rendered again"):
                next(replace(kept, **change).frames())
