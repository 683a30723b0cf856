"""Frames without images, the body of a dataset, and the occluder that passes in front of the person."""

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


def test_the_pose_history_ends_at_the_initial_pose_of_the_motion():
    motion = find_motion("builtin", data=None, rate_hz=30.0)
    info = Blank(first_frame=7).info
    assert (info.initial_pose == motion.poses[7]).all()
    assert (info.pose_history == motion.poses[:8]).all()
    assert info.pose_history_activity == motion.activity
    assert info.rate_hz == 30.0
    assert np.array_equal(info.shape.as_dict(), motion.shape.as_dict())
    assert motion.name in info.name


SHAPE = from_height(1.7)
BODY = full_body(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)), SHAPE)


def test_the_body_of_a_dataset_is_scaled():
    scaled = of_dataset(SequenceInfo("clip", 1, shape=SHAPE, body=BODY), scale=2.0)
    np.testing.assert_allclose(scaled.skeleton.offsets, 2.0 * BODY.skeleton.offsets)
    np.testing.assert_allclose(scaled.limbs.radii, 2.0 * BODY.limbs.radii)
    np.testing.assert_allclose(scaled.limbs.lengths, 2.0 * BODY.limbs.lengths)
    assert scaled.shape.thigh == pytest.approx(2.0 * SHAPE.thigh)


def test_a_shape_without_a_body_gives_the_person_of_that_shape():
    scaled = of_dataset(SequenceInfo("clip", 1, shape=SHAPE), scale=1.1)
    assert len(scaled.skeleton.dof_names) == 25
    assert scaled.shape.thigh == pytest.approx(1.1 * SHAPE.thigh)


def test_a_dataset_without_measurements_needs_a_height():
    with pytest.raises(InputError, match="has no body measurements of the person; set body=height"):
        of_dataset(SequenceInfo("clip", 1))


def test_a_person_of_a_height_may_have_neck_and_feet():
    assert len(of_height(height_m=1.8).limbs) == 12
    assert of_height(height_m=1.8, neck_and_feet=True).limbs.names[12:] == ("neck", "left_foot", "right_foot")


def standing_boxes(n_frames=50):
    return np.repeat(np.array([[[300.0, 100.0], [340.0, 370.0]]]), n_frames, axis=0)


@pytest.mark.parametrize("seed", range(8))
def test_the_occluder_passes_once_between_the_first_and_the_last_frame(seed):
    board = passing_occluder(standing_boxes(), 30.0, np.random.default_rng(seed))
    width = board.texture.shape[1]
    left, right = board.corners[:, 1], board.corners[:, 1] + width
    occludes = (left < 340) & (right > 300)
    assert 3 <= occludes.sum() <= 25
    assert np.abs(np.diff(np.flatnonzero(occludes))).max() == 1
    assert not occludes[0]
    assert not occludes[-1]
    assert 0.5 * 270 <= board.texture.shape[0] <= 1.1 * 270 + 1


def test_images_differ_only_at_the_occluder():
    options = {"n_frames": 12, "width": 160, "height": 120, "person_px": 80.0, "focal_px": 175.0, "seed": 3}
    plain, occluded = (
        [frame.views[0].image.astype(float) for frame in Synthetic(**options, occluder=occluder).frames()]
        for occluder in (False, True)
    )
    changed = [(np.abs(a - b) > 0).mean() for a, b in zip(plain, occluded, strict=True)]
    assert max(changed) > 0.02
    assert all(fraction < 0.35 for fraction in changed)
    repeated = [frame.views[0].image for frame in Synthetic(**options, occluder=True).frames()]
    assert np.array_equal(repeated, occluded)
