"""The bare lookups that the likelihood's kernel is measured against look up what they should."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from analysis.benchmarks.likelihood import packed_lookups
from workbench.likelihoods.image_motion.kernel import GREY_STEP, packed

HEIGHT, WIDTH, N = 37, 53, 400


def test_lookups_of_packed_levels():
    rng = np.random.default_rng(0)
    image = rng.uniform(0.0, 255.0, (HEIGHT, WIDTH)).astype(np.float32)
    x, y = (rng.uniform(0.0, size - 1.001, N).astype(np.float32) for size in (WIDTH, HEIGHT))
    expected = map_coordinates(image.astype(float), [y, x], order=1).sum()
    # a rounded level is off by half a step at most, and independently of the others by 1/√12 of a step
    spread = 6.0 * np.sqrt(N / 12.0)
    assert packed_lookups(packed(image), x, y) * GREY_STEP == pytest.approx(expected, abs=spread * GREY_STEP + 0.01)
