"""Cues that look at the limbs, judged together: the same bits as each by itself."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from workbench.body.kinematics import forward
from workbench.likelihoods.cues.limb_points import (
    LimbLook,
    ViewJudge,
    evaluate_together,
    limb_points,
    limb_points_of_all,
)
from workbench.likelihoods.product import Product

OTHER = scenes.distorted(scenes.FRONT)
SAMPLES = [np.random.default_rng(n).uniform([0.0, -1.0], [1.0, 1.0], (n, 2)) for n in (16, 4, 24)]


@pytest.mark.parametrize("n", [1, 37])
@pytest.mark.parametrize("beside", [False, True])
def test_points_placed_together_are_those_placed_alone(n, beside):
    samples = [points * [1.0, 1.3] for points in SAMPLES] if beside else SAMPLES
    frames = forward(scenes.PERSON.skeleton, scenes.people(np.random.default_rng(0), n))
    together = limb_points_of_all(scenes.PERSON, samples, scenes.FRONT, frames, beside)
    for points, found in zip(samples, together, strict=True):
        alone = limb_points(scenes.PERSON, points, scenes.FRONT, frames, beside)
        for name, values in vars(alone).items():
            np.testing.assert_array_equal(getattr(found, name), values)
            assert getattr(found, name).flags.c_contiguous


def look(name, *judges, body=scenes.PERSON):
    return LimbLook(name, body, judges, lambda expected_pose: None)


def count(points, *beside):
    """Something that depends on all points, and on which of the points are whose."""
    parts = [(each.counts * each.pixels[..., 0]).sum(axis=(1, 2)) for each in (points, *beside)]
    return sum((k + 1.0) * part for k, part in enumerate(parts))


def test_looks_evaluated_together_find_what_each_finds_alone():
    poses = scenes.people(np.random.default_rng(1), 20)
    poses[3, 5] = np.nan
    first, second, third = SAMPLES
    other = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))
    looks = [
        look("one", ViewJudge(scenes.FRONT, first, count)),
        look("views", ViewJudge(scenes.FRONT, second, count), ViewJudge(OTHER, second, count)),
        look("beside", ViewJudge(scenes.FRONT, third, count, third * [1.0, 1.5])),
        look("nothing"),
    ]
    together = evaluate_together(looks, poses)
    for found, each in zip(together, looks, strict=True):
        alone = each.evaluate(poses, poses)
        np.testing.assert_array_equal(found.log_prob, alone.log_prob)
        assert found.log_prob[3] == -np.inf
        assert found.notes == alone.notes == (f"{each.name}: 1 of 20 poses were not finite",)
    assert np.ptp(together[2].log_prob[4:]) > 0.0

    class Seen:
        def __init__(self, seen):
            self.seen = seen

        def look(self, previous, frame):
            return self.seen

    looks[1] = look("rod", ViewJudge(scenes.FRONT, second, count), body=other)
    terms = {each.name: Seen(each) for each in looks}
    found = Product(terms, dict.fromkeys(terms, 1.0)).look(None, None).evaluate(poses, poses).log_prob
    np.testing.assert_array_equal(found, sum(each.evaluate(poses, poses).log_prob for each in looks))
