"""The surface's kernels against their NumPy reference, on the person, on random trees and on parts across joints."""

import numpy as np
import pytest
import surface_scenes as scenes

from tests.oracles import surface as oracle
from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.kinematics import forward
from workbench.body.limbs import skeleton_limbs
from workbench.body.surface import (
    KINDS,
    attach,
    limbs_surface,
    nearest_distances,
    nearest_residual_jacobian,
    residual_jacobian,
    residuals,
)
from workbench.utils.errors import InputError

N_POINTS = [0, 1, 32, 40]  # none, one, one block of the search, and a part of the next one
TREES = [scenes.tree(seed) for seed in range(2)]
SCENES = {
    "person": scenes.PERSON,
    **{f"tree {i}": (tree, limbs_surface(skeleton_limbs(tree))) for i, tree in enumerate(TREES)},
    **{f"parts across joints {i}": (tree, scenes.blended(i, tree)) for i, tree in enumerate(TREES)},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_kernels_agree_with_the_reference(scene, kind):
    rng = np.random.default_rng(5)
    for _ in range(2):
        pose, frames, points = scenes.pose_and_points(rng, *scene, 60)
        attachment = attach(scene[1], forward(scene[0], pose[None]), points, kind)
        np.testing.assert_array_equal(attachment, oracle.attach(scene[1], frames, points, kind))
        for parts in (attachment, rng.integers(len(scene[1].part_names), size=60)):  # the nearest and any
            arguments = (*scene, pose, points, kind, parts)
            expected, expected_jacobian = oracle.residual_jacobian(*arguments)
            values, jacobian = residual_jacobian(*arguments)
            # sums of tens of terms in another order; the residuals are of the size of 1
            np.testing.assert_allclose(values, expected, rtol=1e-11, atol=1e-13)
            np.testing.assert_allclose(residuals(*arguments), values, rtol=1e-13, atol=1e-15)
            np.testing.assert_allclose(jacobian, expected_jacobian, rtol=1e-9, atol=1e-10 * np.abs(jacobian).max())


@pytest.mark.parametrize("n", N_POINTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_the_combined_search_and_derivative_agree_with_the_separate_ones(scene, kind, n):
    pose, frames, points = scenes.pose_and_points(np.random.default_rng(6), *scene, n)
    attachment = oracle.attach(scene[1], frames, points, kind)
    expected, expected_jacobian = residual_jacobian(*scene, pose, points, kind, attachment)
    values, jacobian = nearest_residual_jacobian(*scene, pose, points, kind)
    # the compiler may round the same formulas differently in another kernel
    np.testing.assert_allclose(values, expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(jacobian, expected_jacobian, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
@pytest.mark.slow
def test_distances_in_many_poses_agree_with_the_reference(scene):
    rng = np.random.default_rng(7)
    pose, _, points = scenes.pose_and_points(rng, *scene, N_POINTS[-1])
    poses = pose + 0.1 * rng.standard_normal((20, len(pose)))
    distances = nearest_distances(*scene, poses, points)
    for pose, row in zip(poses, distances, strict=True):
        frames = forward_oracle(scene[0], pose[None])
        expected = np.abs(oracle.distances(scene[1], frames, points)).min(axis=-1)
        np.testing.assert_allclose(np.abs(row), expected, rtol=1e-11, atol=1e-13)
    for n in N_POINTS:
        np.testing.assert_allclose(nearest_distances(*scene, poses, points[:n]), distances[:, :n], rtol=1e-13)


def test_points_that_are_not_finite_are_rejected():
    points = np.array([[0.0, 0.0, 1.0], [0.0, np.nan, 0.0]])
    with pytest.raises(InputError, match="expected finite points, found 1 non-finite ones"):
        nearest_residual_jacobian(*scenes.PERSON, np.zeros(25), points, "distance")
    with pytest.raises(InputError, match="expected finite points, found 1 non-finite ones"):
        nearest_distances(*scenes.PERSON, np.zeros((2, 25)), points)


def test_strided_arrays_give_the_same_residuals():
    """The pose is a column of a larger array; the points are in Fortran order."""
    pose, _, points = scenes.pose_and_points(np.random.default_rng(2), *scenes.PERSON, 50)
    attachment = attach(scenes.PERSON[1], forward(scenes.PERSON[0], pose[None]), np.asfortranarray(points))
    expected = residuals(*scenes.PERSON, pose, points, "distance", attachment)
    column = np.stack([pose, pose], axis=1)[:, 0]
    values = residuals(*scenes.PERSON, column, np.asfortranarray(points), "distance", attachment)
    np.testing.assert_array_equal(values, expected)


def test_arrays_of_the_wrong_shape_are_rejected():
    pose, points, attachment = np.zeros(25), np.zeros((4, 3)), np.zeros(4, dtype=np.int64)
    for wrong in ((pose[1:], points, attachment), (pose, points[:, :2], attachment), (pose, points, attachment[1:])):
        with pytest.raises(ValueError, match="pose, points and attachment must be"):
            residual_jacobian(*scenes.PERSON, wrong[0], wrong[1], "distance", wrong[2])
