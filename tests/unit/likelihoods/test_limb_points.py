"""Points on and about the limbs, by the reference of image motion and by hand; cues that are judged together."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from tests.oracles.image_motion import PosedView, cover, hidden_samples, inside_image, limb_patches
from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.kinematics import forward
from workbench.likelihoods.cues.image_levels import bilinear
from workbench.likelihoods.cues.limb_points import (
    LimbFrameLikelihood,
    LimbViewLikelihood,
    evaluate_jointly,
    levels_at,
    limb_point_sets,
    limb_points,
    mean_at,
)
from workbench.likelihoods.image_motion import regular_samples
from workbench.likelihoods.product import Product

LIMBS = scenes.PERSON.limbs
SAMPLES = regular_samples(30, np.random.default_rng(0))
BESIDE = SAMPLES * [1.0, 2.0]  # some within, most beside


def posed(camera, n=40):
    poses = scenes.people(np.random.default_rng(1), n)
    poses[0, 0] = 5.0  # behind the camera
    frames = forward_oracle(scenes.PERSON.skeleton, poses)
    image = scenes.texture(np.random.default_rng(2), camera.width, camera.height).astype(np.float32)
    return frames, image, limb_patches(LIMBS, PosedView(camera, image, frames))


def not_covered(patches, samples):
    points = patches.positions(samples)
    covered = [
        [cover(patches, k, bool(LIMBS.spheres[k]), points[:, j])[0] for k in range(len(LIMBS))]
        for j in range(len(LIMBS))
    ]
    return ~np.array(covered).any(axis=1).transpose(1, 0, 2)


@pytest.mark.parametrize("camera", [scenes.FRONT, scenes.distorted(scenes.FRONT)], ids=["plain", "distorted"])
@pytest.mark.parametrize("beside", [False, True])
def test_points_agree_with_the_reference(camera, beside):
    frames, image, patches = posed(camera)
    samples = BESIDE if beside else SAMPLES
    found = limb_points(scenes.PERSON, samples, camera, frames, beside)
    places, usable = patches.positions(samples), patches.cos_alpha > 0.0
    seen = not_covered(patches, samples) if beside else ~hidden_samples(LIMBS, patches, samples, "sample")
    expected = inside_image(image, places) & usable[..., None] & seen
    assert 0.1 < expected.mean() < 0.95  # both answers occur
    assert not usable[0].any()
    # float32 holds a pixel of 320 to 2⁻¹⁵ = 3e-5 at most
    np.testing.assert_allclose(found.pixels[usable], places[usable], rtol=0.0, atol=4e-5)
    np.testing.assert_array_equal(found.valid, expected)

    levels = np.where(expected, bilinear(image, found.pixels.astype(float)), 0.0)
    # the interpolation is of float32 grey levels, good to 255 · 2⁻²² or so
    np.testing.assert_allclose(mean_at(image, found), levels.mean(axis=-1), rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(levels_at(image, found.pixels[expected]), levels[expected], rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("heading", [-2.0, 0.0, 0.7, 3.0])
def test_the_turn_of_a_limb_that_stands_upright(heading):
    """The camera looks along −x, so that v = 1 is at world y or −y, in the body's frame turned back by its heading."""
    rod = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.05))
    frames = forward_oracle(rod.skeleton, scenes.root(heading=heading))
    points = limb_points(rod, np.array([[0.5, 0.9]]), scenes.FRONT, frames)
    to_the_right = points.pixels[0, 0, 0, 0] > (scenes.WIDTH - 1) / 2  # image x is world y
    expected = (np.pi / 2 if to_the_right else -np.pi / 2) - heading
    assert np.cos(points.azimuths[0, 0] - expected) == pytest.approx(1.0)


def test_points_about_a_rod_that_another_covers_do_not_count():
    """A broad rod 80 cm behind covers whatever lies beside a thin one; beyond its end nothing does."""
    samples = np.array([[0.5, 0.5], [0.5, 1.5], [0.5, -1.5], [1.5, 0.0]])
    thin, broad = ((0.0, 0.0, -0.2), (0.0, 0.0, 0.2), 0.05), ((-0.8, 0.0, -0.3), (-0.8, 0.0, 0.3), 0.3)
    frames = forward_oracle(scenes.PERSON.skeleton, scenes.root())
    alone, both = (
        limb_points(scenes.rods(*rods), samples, scenes.FRONT, frames, outside=True).valid[0, 0]
        for rods in ((thin,), (thin, broad))
    )
    assert alone.tolist() == [False, True, True, True]
    assert both.tolist() == [False, False, False, True]


OTHER = scenes.distorted(scenes.FRONT)
SETS = [np.random.default_rng(n).uniform([0.0, -1.0], [1.0, 1.0], (n, 2)) for n in (16, 4, 24)]


@pytest.mark.parametrize("n", [1, 37])
@pytest.mark.parametrize("beside", [False, True])
def test_points_placed_together_are_those_placed_alone(n, beside):
    samples = [points * [1.0, 1.3] for points in SETS] if beside else SETS
    frames = forward(scenes.PERSON.skeleton, scenes.people(np.random.default_rng(0), n))
    together = limb_point_sets(scenes.PERSON, samples, scenes.FRONT, frames, beside)
    for points, found in zip(samples, together, strict=True):
        alone = limb_points(scenes.PERSON, points, scenes.FRONT, frames, beside)
        for name, values in vars(alone).items():
            np.testing.assert_array_equal(getattr(found, name), values)
            assert getattr(found, name).flags.c_contiguous


def frame_likelihood(name, *informative, body=scenes.PERSON):
    return LimbFrameLikelihood(name, body, informative, lambda expected_pose: None)


def count(points, *beside):
    """Something that depends on all points, and on which of the points are whose."""
    parts = [(each.valid * each.pixels[..., 0]).sum(axis=(1, 2)) for each in (points, *beside)]
    return sum((k + 1.0) * part for k, part in enumerate(parts))


def test_looks_evaluated_together_find_what_each_finds_alone():
    poses = scenes.people(np.random.default_rng(1), 20)
    poses[3, 5] = np.nan
    first, second, third = SETS
    other = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))
    frame_likelihoods = [
        frame_likelihood("one", LimbViewLikelihood(scenes.FRONT, first, count)),
        frame_likelihood(
            "views", LimbViewLikelihood(scenes.FRONT, second, count), LimbViewLikelihood(OTHER, second, count)
        ),
        frame_likelihood("beside", LimbViewLikelihood(scenes.FRONT, third, count, third * [1.0, 1.5])),
        frame_likelihood("nothing"),
    ]
    together = evaluate_jointly(frame_likelihoods, poses)
    for found, each in zip(together, frame_likelihoods, strict=True):
        alone = each.evaluate(poses, poses)
        np.testing.assert_array_equal(found.log_prob, alone.log_prob)
        assert found.log_prob[3] == -np.inf
        assert found.notes == alone.notes == (f"{each.name}: 1 of 20 poses were not finite",)
    assert np.ptp(together[2].log_prob[4:]) > 0.0

    class Seen:
        def __init__(self, seen):
            self.seen = seen

        def prepare(self, previous, frame):
            return self.seen

    frame_likelihoods[1] = frame_likelihood("rod", LimbViewLikelihood(scenes.FRONT, second, count), body=other)
    terms = {each.name: Seen(each) for each in frame_likelihoods}
    found = Product(terms, dict.fromkeys(terms, 1.0)).prepare(None, None).evaluate(poses, poses).log_prob
    np.testing.assert_array_equal(found, sum(each.evaluate(poses, poses).log_prob for each in frame_likelihoods))
