"""The height of a person in an image, standing, lying and partly seen."""

import numpy as np

from workbench.cameras.image_height import height_px

STANDING = np.array([[50.0, 10.0], [40.0, 90.0], [62.0, 210.0]])


def test_the_height_is_the_longer_side_of_the_box_of_an_upright_and_of_a_lying_person():
    assert height_px(STANDING) == 200.0
    np.testing.assert_array_equal(height_px(np.stack([STANDING, STANDING[:, ::-1], 0.5 * STANDING])), [200, 200, 100])


def test_missing_joints_are_ignored():
    pixels = np.stack([STANDING] * 4)
    pixels[0, 2] = pixels[1, 1:] = pixels[2] = np.nan
    pixels[3, 0, 1] = np.nan  # half a joint is none
    np.testing.assert_array_equal(height_px(pixels), [80.0, 0.0, 0.0, 120.0])
    assert height_px(np.empty((0, 2))) == 0.0
