"""The distances between two cameras' rays over shifts of one clock."""

import numpy as np
import pytest

from workbench.cameras.camera import plain_camera
from workbench.cameras.time_offset import distance_curve

CAMERAS = [plain_camera(640, 480, 500.0, position, (0.0, 0.0, 1.0)) for position in ((4.0, 0.0, 1.0), (0.0, 4.0, 1.5))]


def rays(camera, times_s):
    """Return the rays (T, 1, 3) to a point that moves back and forth."""
    points = np.stack([0.3 * np.sin(3.0 * times_s), 0.4 * np.cos(2.0 * times_s), 1.0 + 0.2 * times_s], axis=1)
    directions = points[:, None] - camera.position
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def curve(b_s, late_s, shifts_s, average):
    """Return the curve of two cameras, the second of which started late, so that its clock reads too little."""
    a_s = np.arange(60) / 30.0
    first, second = CAMERAS
    return distance_curve(
        rays(first, a_s), a_s, rays(second, b_s + late_s), b_s, second.position - first.position, shifts_s, average
    )


@pytest.mark.parametrize("rate_hz", [30.0, 60.0])
def test_rays_meet_at_the_true_shift(rate_hz):
    shifts_s = np.arange(-6, 7) / 30.0
    distances = curve(np.arange(2 * rate_hz) / rate_hz, 0.1, shifts_s, np.mean)
    assert shifts_s[np.argmin(distances)] == pytest.approx(0.1)
    assert distances.min() < 1e-9
    assert distances[6] > 0.01


def test_frames_without_a_frame_of_the_other_camera_are_not_compared():
    with_gap_s = np.concatenate([np.arange(20), np.arange(40, 60)]) / 30.0
    assert curve(with_gap_s, 0.0, np.array([0.0, 0.1]), len).tolist() == [40.0, 37.0]
