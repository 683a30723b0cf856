"""Left and right put right again: by how joints move in one view, by where rays meet in several."""

import numpy as np
import pytest
from crowd_scenes import CAMERAS, RATE_HZ, shown, walkers

from workbench.datasets.association.detections import DetectorView
from workbench.datasets.association.left_right import PARTS, _cheapest, _cost, exchanged_sides, undone

WALK = (((-0.8, -0.2), (1.6, 0.0)),)
ALL = np.ones(15, dtype=bool)


def seen(names, n_frames=40, seed=0):
    """Eyes and (V, T, J, 3) of a walker."""
    found = shown({name: CAMERAS[name] for name in names}, walkers(WALK, n_frames), np.random.default_rng(seed))
    eyes = [
        DetectorView(CAMERAS[name] if len(names) > 1 else None, ALL, 1.0 if len(names) > 1 else 300.0) for name in names
    ]
    return eyes, np.array([found[name][0] for name in names])


@pytest.mark.parametrize("names", [["left"], ["front", "left"], list(CAMERAS)])
def test_nothing_is_exchanged_where_nothing_was(names):
    eyes, joints = seen(names)
    assert not exchanged_sides(eyes, joints, RATE_HZ).any()


@pytest.mark.parametrize("names", [["left"], ["front", "left"], list(CAMERAS)])
@pytest.mark.parametrize("frames", [slice(7, 8), slice(12, 20), slice(0, 5), slice(36, 40)])  # arms apart
def test_what_was_exchanged_is_found(names, frames):
    eyes, joints = seen(names)
    swapped = np.zeros((len(names), 40, len(PARTS)), dtype=bool)
    swapped[0, frames] = True
    swapped[-1, 25:28, 1] = True
    found = exchanged_sides(eyes, undone(joints, swapped), RATE_HZ)
    np.testing.assert_array_equal(found, swapped)
    np.testing.assert_array_equal(undone(undone(joints, swapped), found), joints)


def test_the_path_is_the_cheapest_of_all():
    rng = np.random.default_rng(0)
    for _ in range(5):
        costs = 3.0 * rng.random((6, 2, 2, 2))
        paths = [np.array([bool(number >> t & 1) for t in range(6)]) for number in range(64)]
        best = min(paths, key=lambda path: _cost(costs, path))
        np.testing.assert_array_equal(_cheapest(costs), best)
