"""A board that passes in front of the person."""

import numpy as np
import pytest

from workbench.datasets.rendering.surroundings import passing_board
from workbench.datasets.synthetic import Synthetic


def standing(n=50):
    return np.repeat(np.array([[[300.0, 100.0], [340.0, 370.0]]]), n, axis=0)


@pytest.mark.parametrize("seed", range(8))
def test_it_passes_once_and_is_beside_the_person_before_and_after(seed):
    board = passing_board(standing(), 30.0, np.random.default_rng(seed))
    width = board.picture.shape[1]
    left, right = board.corners[:, 1], board.corners[:, 1] + width
    hides = (left < 340) & (right > 300)
    assert 3 <= hides.sum() <= 25
    assert np.abs(np.diff(np.flatnonzero(hides))).max() == 1  # once
    assert not hides[0]
    assert not hides[-1]
    assert 0.5 * 270 <= board.picture.shape[0] <= 1.1 * 270 + 1


def test_a_scene_with_it_differs_only_where_it_is():
    size = {"n_frames": 12, "width": 160, "height": 120, "person_px": 80.0, "focal_px": 175.0, "seed": 3}
    plain, behind = (
        [frame.views[0].image.astype(float) for frame in Synthetic(**size, occluder=own).frames()]
        for own in (False, True)
    )
    changed = [(np.abs(a - b) > 0).mean() for a, b in zip(plain, behind, strict=True)]
    assert max(changed) > 0.02
    assert all(share < 0.35 for share in changed)
    again = [frame.views[0].image for frame in Synthetic(**size, occluder=True).frames()]
    assert np.array_equal(again, behind)
    assert Synthetic(**size)._key() != Synthetic(**size, occluder=True)._key()
