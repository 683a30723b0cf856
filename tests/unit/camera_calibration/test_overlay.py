"""Axes and annotations are drawn where the camera projects them."""

import numpy as np
from seen_walkers import around, seen_by

from workbench.camera_calibration.overlay import AXES, LEFT, draw_overlay


def test_axes_and_marks_are_drawn_where_they_are_projected():
    camera = around(3)[0]  # from aside, so that no axis hides another
    seen = seen_by([camera], sigma_px=0.0)
    picture = draw_overlay(camera, seen.images[0], seen.marks[0, 0], np.full((15, 3), np.nan), 0.0)
    assert picture.shape == (960, 1280, 3)
    for way, colour in zip(0.5 * np.eye(3), AXES.values(), strict=True):
        u, v = np.round(camera.project(way)).astype(int)
        near = picture[v - 3 : v + 4, u - 3 : u + 4].reshape(-1, 3)
        assert (near == colour).all(axis=1).any(), colour
    u, v = np.round(seen.marks[0, 0, 9, :2]).astype(int)  # the left hip
    around_hip = picture[v - 6 : v + 7, u - 6 : u + 7].reshape(-1, 3).astype(int)
    assert np.abs(around_hip - LEFT).sum(axis=1).min() < 60  # its edges are smoothed
