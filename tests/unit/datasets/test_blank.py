"""Frames without images, the body a dataset knows, and a board that passes in front of the person."""

import numpy as np
import pytest
from full_skeleton_clips import BANDAI_LIKE, clip, wandering

from workbench.body.shape import from_height
from workbench.core.dataset import SequenceInfo
from workbench.datasets.blank import Blank
from workbench.datasets.person import of_dataset, of_height
from workbench.datasets.rendering.surroundings import passing_occluder
from workbench.datasets.synthetic import Synthetic
from workbench.motion.full_skeleton import full_body
from workbench.motion.sources import find_motion
from workbench.utils.errors import InputError


def test_the_start_is_the_motions_and_the_lead_in_ends_there():
    motion = find_motion("builtin", data=None, rate_hz=30.0)
    known = Blank(first_frame=7).info
    assert (known.initial_pose == motion.poses[7]).all()
    assert (known.pose_history == motion.poses[:8]).all()
    assert known.pose_history_activity == motion.activity
    assert known.rate_hz == 30.0
    assert np.array_equal(known.shape.as_dict(), motion.shape.as_dict())
    assert motion.name in known.name


SHAPE = from_height(1.7)
BODY = full_body(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)), SHAPE)


def test_a_dataset_with_a_body_of_its_own_is_tracked_on_it():
    twice = of_dataset(SequenceInfo("clip", 1, shape=SHAPE, body=BODY), scale=2.0)
    np.testing.assert_allclose(twice.skeleton.offsets, 2.0 * BODY.skeleton.offsets)
    np.testing.assert_allclose(twice.limbs.radii, 2.0 * BODY.limbs.radii)
    np.testing.assert_allclose(twice.limbs.lengths, 2.0 * BODY.limbs.lengths)
    assert twice.shape.thigh == pytest.approx(2.0 * SHAPE.thigh)


def test_a_dataset_that_measured_its_person_gives_them():
    taller = of_dataset(SequenceInfo("clip", 1, shape=SHAPE), scale=1.1)
    assert len(taller.skeleton.dof_names) == 25
    assert taller.shape.thigh == pytest.approx(1.1 * SHAPE.thigh)


def test_who_is_not_known_is_refused():
    with pytest.raises(InputError, match="has no body measurements of the person; set body=height"):
        of_dataset(SequenceInfo("clip", 1))


def test_somebody_of_a_height_may_have_neck_and_feet():
    assert len(of_height(height_m=1.8).limbs) == 12
    assert of_height(height_m=1.8, neck_and_feet=True).limbs.names[12:] == ("neck", "left_foot", "right_foot")


def standing(n=50):
    return np.repeat(np.array([[[300.0, 100.0], [340.0, 370.0]]]), n, axis=0)


@pytest.mark.parametrize("seed", range(8))
def test_it_passes_once_and_is_beside_the_person_before_and_after(seed):
    board = passing_occluder(standing(), 30.0, np.random.default_rng(seed))
    width = board.texture.shape[1]
    left, right = board.corners[:, 1], board.corners[:, 1] + width
    hides = (left < 340) & (right > 300)
    assert 3 <= hides.sum() <= 25
    assert np.abs(np.diff(np.flatnonzero(hides))).max() == 1  # once
    assert not hides[0]
    assert not hides[-1]
    assert 0.5 * 270 <= board.texture.shape[0] <= 1.1 * 270 + 1


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
