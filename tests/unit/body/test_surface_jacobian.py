"""Derivatives of the surface's residuals by central differences, and their invariance to rigid motions."""

import numpy as np
import pytest
import surface_scenes as scenes
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.kinematics import forward
from workbench.body.limbs import skeleton_limbs
from workbench.body.surface import KINDS, attach, limbs_surface, residual_jacobian, residuals

SEEDS = st.integers(0, 2**32 - 1)
TREE = scenes.tree(7)
SCENES = {
    "person": scenes.PERSON,
    "tree": (TREE, limbs_surface(skeleton_limbs(TREE))),
    "parts across joints": (TREE, scenes.blended(7, TREE)),
}
STEP = 1e-7  # rounding and seams of two limbs stay below 1e-8 of the derivative, which is checked to 1e-6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
@settings(max_examples=15)
@given(seed=SEEDS)
def test_the_jacobian_is_the_derivative(scene, kind, seed):
    rng = np.random.default_rng(seed)
    pose, _, points = scenes.pose_and_points(rng, *scene, 40)
    attachment = attach(scene[1], forward(scene[0], pose[None]), points, kind)
    _, jacobian = residual_jacobian(*scene, pose, points, kind, attachment)
    differences = np.empty_like(jacobian)
    for p in range(len(pose)):
        up, down = (
            residuals(*scene, pose + s * STEP * np.eye(len(pose))[p], points, kind, attachment) for s in (1, -1)
        )
        differences[:, p] = (up - down) / (2.0 * STEP)
    largest = np.abs(jacobian).max(axis=1, keepdims=True)
    assert np.all(np.abs(jacobian - differences) <= 1e-6 * np.maximum(largest, 1e-3 * largest.max()))


def test_a_point_at_an_ellipsoids_centre_has_a_finite_gradient():
    scene = scenes.lone((0.05, 0.08, 0.2))
    for kind in KINDS:
        values, jacobian = residual_jacobian(*scene, np.zeros(6), np.zeros((1, 3)), kind, np.zeros(1, dtype=np.int64))
        assert np.isfinite(values).all()
        np.testing.assert_allclose(jacobian, 0.0, atol=1e-12)
