"""The body a dataset knows: its own, or its person's as measured."""

import numpy as np
import pytest
from full_skeleton_clips import BANDAI_LIKE, clip, wandering

from workbench.body.shape import from_height
from workbench.core.dataset import Known
from workbench.datasets.person import of_dataset, of_height
from workbench.motion.full_skeleton import full_body
from workbench.utils.errors import InputError

SHAPE = from_height(1.7)
BODY = full_body(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)), SHAPE)


def test_a_dataset_with_a_body_of_its_own_is_tracked_on_it():
    twice = of_dataset(Known("clip", 1, shape=SHAPE, body=BODY), scale=2.0)
    np.testing.assert_allclose(twice.skeleton.offsets, 2.0 * BODY.skeleton.offsets)
    np.testing.assert_allclose(twice.limbs.radii, 2.0 * BODY.limbs.radii)
    np.testing.assert_allclose(twice.limbs.lengths, 2.0 * BODY.limbs.lengths)
    assert twice.shape.thigh == pytest.approx(2.0 * SHAPE.thigh)


def test_a_dataset_that_measured_its_person_gives_them():
    taller = of_dataset(Known("clip", 1, shape=SHAPE), scale=1.1)
    assert len(taller.skeleton.dof_names) == 25
    assert taller.shape.thigh == pytest.approx(1.1 * SHAPE.thigh)


def test_who_is_not_known_is_refused():
    with pytest.raises(InputError, match="does not know the person's size; choose body=height"):
        of_dataset(Known("clip", 1))


def test_somebody_of_a_height_may_have_neck_and_feet():
    assert len(of_height(height_m=1.8).limbs) == 12
    assert of_height(height_m=1.8, feet=True).limbs.names[12:] == ("neck", "left_foot", "right_foot")
