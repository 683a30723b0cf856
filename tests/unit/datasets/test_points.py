"""Simulated point clouds: noise, outliers, occluders and clutter have their parameters' sizes."""

import numpy as np
import pytest

from workbench.datasets.points import Points
from workbench.datasets.rendering.surroundings import BOX_M, WALL_M
from workbench.datasets.rendering.visible import first_depth

SMALL = {"n_frames": 3, "n_points": 200}


def scene(**parameters):
    """Return a dataset without perturbations, which test_perturbations tests."""
    return Points(**{**SMALL, "perturb": False, **parameters})


def clouds(dataset):
    return [frame.points for frame in dataset.frames()]


def distance_behind_surface(dataset, i, points):
    """Return the distances of points behind the body along the line of sight, m; inf where it misses the body."""
    depth = dataset.true_camera.to_camera(points)[:, 2]
    return depth - first_depth(dataset.sequence.body, dataset.sequence.motion.poses[i], dataset.true_camera, points)


def test_points_without_noise_lie_on_the_visible_surface():
    dataset = scene(sigma_m=0.0, outlier_fraction=0.0)
    for i, points in enumerate(clouds(dataset)):
        assert np.abs(distance_behind_surface(dataset, i, points)).max() < 1e-3


def test_noise_and_outliers_have_their_standard_deviation_and_fraction():
    dataset = scene(n_points=4000, n_frames=2, outlier_fraction=0.3)
    points = next(dataset.frames()).points
    near = np.abs(distance_behind_surface(dataset, 0, points)) < 0.08  # four standard deviations
    # about 2 % of the outliers, uniform in 5.6 m³, are this near; noisy points at the outline may miss the body
    assert near.mean() == pytest.approx(0.7, abs=0.05)
    root = dataset.sequence.motion.poses[0, :3]
    assert (np.abs(points[~near] - root) < BOX_M + 0.1).all()
    depth = dataset.true_camera.to_camera(points[near])[:, 2] / 4.0
    sigma = distance_behind_surface(dataset, 0, points[near]) / depth**2
    assert np.quantile(sigma, 0.84) - np.quantile(sigma, 0.16) == pytest.approx(2 * 0.02, rel=0.1)
    # points are in random order: 4 standard errors of a fraction of 1000 points
    assert near[-1000:].mean() == pytest.approx(near.mean(), abs=4 * np.sqrt(0.25 / 1000))


def test_the_camera_has_its_distance_unless_the_motion_needs_a_larger_one():
    dataset = scene(n_frames=20, distance_m=5.0)
    depth = dataset.true_camera.to_camera(dataset.sequence.motion.poses[10, :3][None])[0, 2]
    assert depth == pytest.approx(5.0)
    with pytest.warns(UserWarning, match=r"the camera is \d\.\d m away instead of 4"):
        _ = scene(motion="builtin_run", n_frames=40).true_camera


def test_points_are_reproducible_and_depend_on_every_parameter():
    first = clouds(scene())
    assert all(np.array_equal(a, b) for a, b in zip(first, clouds(scene()), strict=True))
    for change in (
        {"seed": 1}, {"n_points": 199}, {"sigma_m": 0.03}, {"outlier_fraction": 0.2},
        {"n_clutter_points": 20}, {"occluder_width_m": 0.3},
        {"distance_m": 5.0}, {"view_azimuth_deg": 60.0}, {"first_frame": 1}, {"path": "circle"}, {"rate_hz": 30.0},
        {"motion": "builtin_run"}, {"motion": ["builtin"] * 2, "n_frames": 8},
    ):  # fmt: skip
        assert not np.array_equal(first[2], clouds(scene(**change))[2]), change


def test_a_bar_occludes_the_points_behind_it():
    unoccluded, occluded = (scene(outlier_fraction=0.0, occluder_width_m=width) for width in (0.0, 0.12))
    camera, root = occluded.true_camera, occluded.sequence.motion.poses[1, :3]
    centre = camera.position
    direction = (root - centre)[:2] / np.linalg.norm((root - centre)[:2])
    for all_points, visible in zip(clouds(unoccluded), clouds(occluded), strict=True):
        assert 20 < len(visible) < len(all_points) == 200
        side = (visible[:, :2] - centre[:2]) @ [-direction[1], direction[0]]
        along = (visible[:, :2] - centre[:2]) @ direction
        # the bar of radius 6 cm at 2 m occludes lines of sight within 6 cm of its axis
        assert (np.abs(side / along) * 2.0 > 0.06 * 0.99).all()
    assert len(clouds(scene(outlier_fraction=0.0, occluder_width_m=4.0))[0]) == 0


def test_clutter_lies_on_floor_wall_and_bins_behind_the_person():
    dataset = scene(sigma_m=0.0, outlier_fraction=0.0, n_clutter_points=600)
    around, camera = dataset._surroundings, dataset.true_camera
    for i, points in enumerate(clouds(dataset)):
        root = dataset.sequence.motion.poses[i, :3]
        distance = distance_behind_surface(dataset, i, points)
        others = points[~(np.abs(distance) < 1e-3)]
        assert 300 < len(others) <= 600
        assert (distance <= 1e-3).all()  # clutter behind the person is occluded
        assert (np.abs(others - root) <= BOX_M + 1e-9).all()
        depth = camera.to_camera(others)[:, 2]
        floor, wall = np.abs(others[:, 2] - around.floor_m) < 1e-9, np.abs(depth - around.wall_m) < 1e-9
        bins = first_depth(around.bins, np.zeros(25), camera, others)
        assert (floor | wall | (np.abs(bins - depth) < 1e-3)).all()
        assert floor.any()
        assert wall.any()
        assert depth.max() <= around.wall_m + 1e-9
    assert around.wall_m > camera.to_camera(dataset.sequence.motion.poses[:, :3])[:, 2].max() + WALL_M - 1e-9
