"""Flips in depth: the same image, their own inverse, and weighted proposals with the prior's moments."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.ar_offsets import AROffsets
from workbench.priors.kinematic_flips import LIMBS, KinematicFlips, angles, stratified_choice
from workbench.priors.smooth import Smooth

DT = 1 / 30
SKELETON = person_skeleton(from_height(1.75))


def camera_at(distance):
    return plain_camera(640, 480, 60.0 * distance, (distance, -0.6 * distance, 1.0), (0.0, 0.0, 1.0))


def flips(distance=1000.0, **options):
    return KinematicFlips(Smooth(parameters=["left_arm"]), lambda: camera_at(distance), **options)


def poses(n=300):
    """Return poses with bent limbs, most of which can flip within the limits."""
    rng = np.random.default_rng(0)
    poses = np.repeat(builtin_motions()[0].poses[:1], n, axis=0)
    for limb in LIMBS:
        turn, bend = (POSE_NAMES.index(name) for name in angles(limb))
        poses[:, turn], poses[:, bend] = rng.uniform(-0.5, 0.5, n), rng.uniform(0.05, 1.5, n)
    poses[:, POSE_NAMES.index("root_heading")] = rng.uniform(-3.0, 3.0, n)
    return poses


@pytest.mark.parametrize("limb", LIMBS)
def test_a_flipped_limb_has_the_same_distant_image_and_the_mirrored_depth(limb):
    prior, camera, before = flips(), camera_at(1000.0), poses()
    after = prior.flip(before, limb)
    changed = (after != before).any(axis=1)
    assert 10 < changed.sum() < len(before)  # limits forbid some
    end = SKELETON.joint(f"{limb[0]}_{'wrist' if limb[2] == 'elbow' else 'ankle'}")
    positions = [joints(SKELETON, flipped[changed]) for flipped in (before, after)]
    pixels = [camera.project(points) for points in positions]
    # 60 px a metre: a limb of 0.4 m flipped by at most 0.8 m at 1000 m shifts by less than 0.1 %
    np.testing.assert_allclose(pixels[0], pixels[1], atol=0.05)
    lower = SKELETON.joint(f"{limb[0]}_{limb[2]}")
    depth = [(points[:, end] - points[:, lower]) @ np.array([1.0, -0.6, 0.0]) for points in positions]
    np.testing.assert_allclose(depth[0], -depth[1], atol=2e-3)
    assert np.abs(depth[0]).max() > 0.1
    limits = SKELETON.limits
    assert ((after >= limits[:, 0] - 1e-9) & (after <= limits[:, 1] + 1e-9))[changed].all()


@pytest.mark.parametrize("limb", LIMBS)
def test_a_second_flip_undoes_the_first(limb):
    prior, before = flips(distance=4.0), poses()
    np.testing.assert_allclose(prior.flip(prior.flip(before, limb), limb), before, atol=1e-7)


def test_weighted_proposals_have_the_moments_of_the_transition():
    """Flips change the elbow's flexion and the shoulder's twist."""
    n = 50_000
    prior = flips(probability=0.05, proposal_fraction=0.4, distance=4.0)
    pose = poses(60)
    pose = pose[np.abs(prior.flip(pose, LIMBS[0]) - pose).sum(axis=1).argmax()]
    state = np.repeat(prior.base.enter(pose[None], np.zeros((1, 25))), n, axis=0)
    drawn = prior.sample_transition(state, DT, np.random.default_rng(1))
    proposed, log_weights = prior.propose(state, DT, np.random.default_rng(2))
    weights = np.exp(log_weights)
    assert weights.mean() == pytest.approx(1.0, abs=20 / n)  # counts are exact to one particle
    for name in angles(LIMBS[0]):
        column = prior.space.names.index(name)
        for power in (1, 2, 3):
            weighted, plain = weights * proposed[:, column] ** power, drawn[:, column] ** power
            error = np.sqrt((weighted.var() + plain.var()) / n)
            assert abs(weighted.mean() - plain.mean()) < 5 * error
    twist = prior.space.names.index(angles(LIMBS[0])[0])
    assert drawn[:, twist].std() > 2 * prior.base.sigma[2]  # flips happened


def test_offsets_flip_as_angles_do():
    prior = KinematicFlips(
        AROffsets(Smooth(), sigma=1e-6), lambda: camera_at(4.0), proposal_fraction=0.9, probability=0.9
    )
    pose = poses(60)
    pose = pose[(prior.flip(pose, LIMBS[0]) != pose).any(axis=1)][0]
    state = np.zeros((400, len(prior.space)))
    state[:, : len(prior.base.base.space)] = prior.base.base.enter(pose[None], np.zeros((1, 25)))
    flipped, limb = prior._flipped(state, 0.9, np.random.default_rng(0))
    expected = prior.flip(pose[None], prior.limbs[0])[0]
    np.testing.assert_allclose(prior.pose(flipped[limb == 1]), np.repeat(expected[None], (limb == 1).sum(), axis=0))
    np.testing.assert_array_equal(flipped[limb == 0], state[limb == 0])


@pytest.mark.parametrize("n", [1, 7, 10, 1000])
def test_stratified_counts_differ_from_the_expected_by_less_than_one(n):
    for seed in range(20):
        chosen = stratified_choice(np.array([0.5, 0.0, 0.3, 0.2]), n, np.random.default_rng(seed))
        counts = np.bincount(chosen, minlength=4)
        assert np.abs(counts - n * np.array([0.5, 0.0, 0.3, 0.2])).max() < 1.0 + 1e-9
        assert counts[1] == 0


def test_each_particle_has_the_choices_probabilities():
    """Particles of one parent, which are adjacent after resampling, do not all get the same choice."""
    rng = np.random.default_rng(0)
    frequencies = np.array([stratified_choice(np.array([0.7, 0.3]), 5, rng) for _ in range(5000)]).mean(axis=0)
    assert np.abs(frequencies - 0.3).max() <= 5 * np.sqrt(0.3 * 0.7 / 5000)
