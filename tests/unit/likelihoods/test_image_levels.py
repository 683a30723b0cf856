"""Log ratios of images to the background, computed in strips."""

import likelihood_scenes as scenes
import numba
import numpy as np
import pytest

from workbench.cameras.camera import plain_camera
from workbench.core.frame import View
from workbench.likelihoods.cues.image_levels import StaticBackground, background_log_ratio, colour_levels


@pytest.mark.parametrize(("blur_px", "height"), [(0.0, 128), (1.5, 149)])
@pytest.mark.parametrize("colours", [(), (3,)])
@pytest.mark.parametrize("n_threads", [1, 2])
def test_the_log_ratio_in_strips_is_that_of_the_image(blur_px, height, colours, n_threads):
    rng = np.random.default_rng(3)
    camera = plain_camera(70, height, scenes.FOCAL, (4.0, 0.0, 0.0), (0.0, 0.0, 0.0), name="front")
    view = View(camera, rng.integers(0, 256, (height, 70, *colours), dtype=np.uint8))
    levels, epsilon = colour_levels(view, blur_px), 0.05
    median = np.clip(levels + rng.normal(0.0, 8.0, levels.shape), 0.0, 255.0).astype(np.float32)
    background = StaticBackground(median, rng.uniform(3.0, 6.0, levels.shape).astype(np.float32))
    normal = (background.log_peak - 0.5 * ((levels - median) / background.sigma) ** 2).mean(axis=2)
    expected = -np.log(epsilon + (1.0 - epsilon) * np.exp(normal))
    default_threads = numba.get_num_threads()
    try:
        numba.set_num_threads(min(n_threads, numba.config.NUMBA_NUM_THREADS))
        ratio = background_log_ratio(view, background, blur_px, epsilon)
    finally:
        numba.set_num_threads(default_threads)
    assert ratio.dtype == np.float32
    np.testing.assert_array_equal(ratio, expected.astype(np.float32))
    assert ratio.min() < 0.0 < ratio.max()
