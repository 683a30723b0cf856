"""Points on and around the limbs against the reference of image motion, and cues that are evaluated jointly."""

from types import SimpleNamespace

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
OUTSIDE = SAMPLES * [1.0, 2.0]  # most are outside of the limbs


def posed(camera, n=40):
    poses = scenes.people(np.random.default_rng(1), n)
    poses[0, 0] = 5.0  # behind the camera
    frames = forward_oracle(scenes.PERSON.skeleton, poses)
    image = scenes.texture(np.random.default_rng(2), camera.width, camera.height).astype(np.float32)
    return frames, image, limb_patches(LIMBS, PosedView(camera, image, frames))


def uncovered(patches, samples):
    points = patches.positions(samples)
    covered = [
        [cover(patches, k, bool(LIMBS.spheres[k]), points[:, j])[0] for k in range(len(LIMBS))]
        for j in range(len(LIMBS))
    ]
    return ~np.array(covered).any(axis=1).transpose(1, 0, 2)


@pytest.mark.parametrize("camera", [scenes.FRONT, scenes.distorted(scenes.FRONT)], ids=["plain", "distorted"])
@pytest.mark.parametrize("outside", [False, True])
def test_points_agree_with_the_reference(camera, outside):
    frames, image, patches = posed(camera)
    samples = OUTSIDE if outside else SAMPLES
    computed = limb_points(scenes.PERSON, samples, camera, frames, outside)
    positions, usable = patches.positions(samples), patches.cos_alpha > 0.0
    visible = uncovered(patches, samples) if outside else ~hidden_samples(LIMBS, patches, samples, "sample")
    expected = inside_image(image, positions) & usable[..., None] & visible
    assert 0.1 < expected.mean() < 0.95
    assert not usable[0].any()
    # the rounding error of a float32 coordinate up to 320 px is 2⁻¹⁵ = 3e-5
    np.testing.assert_allclose(computed.pixels[usable], positions[usable], rtol=0.0, atol=4e-5)
    np.testing.assert_array_equal(computed.valid, expected)

    levels = np.where(expected, bilinear(image, computed.pixels.astype(float)), 0.0)
    # the error of interpolated float32 grey levels is about 255 · 2⁻²²
    np.testing.assert_allclose(mean_at(image, computed), levels.mean(axis=-1), rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(levels_at(image, computed.pixels[expected]), levels[expected], rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("heading", [-2.0, 0.0, 0.7, 3.0])
def test_the_azimuth_of_an_upright_limb(heading):
    """The camera looks along −x, so that v = 1 is at y or −y in the world, and rotated by −heading in the body."""
    rod = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.05))
    frames = forward_oracle(rod.skeleton, scenes.root(heading=heading))
    points = limb_points(rod, np.array([[0.5, 0.9]]), scenes.FRONT, frames)
    to_the_right = points.pixels[0, 0, 0, 0] > (scenes.WIDTH - 1) / 2  # image x is world y
    expected = (np.pi / 2 if to_the_right else -np.pi / 2) - heading
    assert np.cos(points.azimuths[0, 0] - expected) == pytest.approx(1.0)


def test_contour_samples_on_another_limb_are_not_valid():
    """A wide rod, 80 cm behind, covers the samples on both sides of a thin one, but not the one beyond its end."""
    samples = np.array([[0.5, 0.5], [0.5, 1.5], [0.5, -1.5], [1.5, 0.0]])
    thin, wide = ((0.0, 0.0, -0.2), (0.0, 0.0, 0.2), 0.05), ((-0.8, 0.0, -0.3), (-0.8, 0.0, 0.3), 0.3)
    frames = forward_oracle(scenes.PERSON.skeleton, scenes.root())
    alone, both = (
        limb_points(scenes.rods(*rods), samples, scenes.FRONT, frames, outside=True).valid[0, 0]
        for rods in ((thin,), (thin, wide))
    )
    assert alone.tolist() == [False, True, True, True]
    assert both.tolist() == [False, False, False, True]


DISTORTED = scenes.distorted(scenes.FRONT)
SAMPLE_SETS = [np.random.default_rng(n).uniform([0.0, -1.0], [1.0, 1.0], (n, 2)) for n in (16, 4, 24)]


@pytest.mark.parametrize("n", [1, 37])
@pytest.mark.parametrize("outside", [False, True])
def test_sample_sets_projected_jointly_are_those_projected_separately(n, outside):
    samples = [points * [1.0, 1.3] for points in SAMPLE_SETS] if outside else SAMPLE_SETS
    frames = forward(scenes.PERSON.skeleton, scenes.people(np.random.default_rng(0), n))
    computed = limb_point_sets(scenes.PERSON, samples, scenes.FRONT, frames, outside)
    for points, jointly in zip(samples, computed, strict=True):
        separately = limb_points(scenes.PERSON, points, scenes.FRONT, frames, outside)
        for name, values in vars(separately).items():
            np.testing.assert_array_equal(getattr(jointly, name), values)
            assert getattr(jointly, name).flags.c_contiguous


def frame_likelihood(name, *informative, body=scenes.PERSON):
    return LimbFrameLikelihood(name, body, informative, lambda expected_pose: None)


def count(points, *outside):
    """Return a number per pose that depends on all points and on their limbs."""
    sums = [(limb_samples.valid * limb_samples.pixels[..., 0]).sum(axis=(1, 2)) for limb_samples in (points, *outside)]
    return sum((k + 1.0) * term for k, term in enumerate(sums))


def test_joint_evaluation_agrees_with_separate_evaluation():
    poses = scenes.people(np.random.default_rng(1), 20)
    poses[3, 5] = np.nan
    first, second, third = SAMPLE_SETS
    rod = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))
    frame_likelihoods = [
        frame_likelihood("one", LimbViewLikelihood(scenes.FRONT, first, count)),
        frame_likelihood(
            "views", LimbViewLikelihood(scenes.FRONT, second, count), LimbViewLikelihood(DISTORTED, second, count)
        ),
        frame_likelihood("outside", LimbViewLikelihood(scenes.FRONT, third, count, third * [1.0, 1.5])),
        frame_likelihood("empty"),
    ]
    evaluations = evaluate_jointly(frame_likelihoods, poses)
    for evaluation, single in zip(evaluations, frame_likelihoods, strict=True):
        expected = single.evaluate(poses, poses)
        np.testing.assert_array_equal(evaluation.log_prob, expected.log_prob)
        assert evaluation.log_prob[3] == -np.inf
        assert evaluation.notes == expected.notes == (f"{single.name}: 1 of 20 poses were not finite",)
    assert np.ptp(evaluations[2].log_prob[4:]) > 0.0
    frame_likelihoods[1] = frame_likelihood("rod", LimbViewLikelihood(scenes.FRONT, second, count), body=rod)
    terms = {each.name: SimpleNamespace(prepare=lambda previous, frame, each=each: each) for each in frame_likelihoods}
    product = Product(terms, dict.fromkeys(terms, 1.0)).prepare(None, None).evaluate(poses, poses).log_prob
    np.testing.assert_array_equal(product, sum(each.evaluate(poses, poses).log_prob for each in frame_likelihoods))
