"""Bodies on full skeletons: limbs in any direction are rendered, drawn and fitted alike."""

import numpy as np
import pytest
from full_skeleton_clips import BANDAI_LIKE, clip, wandering

from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import OVERHANG, attach, person_surface, residuals
from workbench.datasets.rendering.visible import surface_points
from workbench.motion.full_skeleton import full_body

SHAPE = from_height(1.7)
BODY = full_body(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)), SHAPE)


def test_a_limbs_axes_are_orthonormal_with_z_along_it():
    for limbs in (BODY.limbs, person(SHAPE).limbs):
        np.testing.assert_allclose(limbs.axes.swapaxes(1, 2) @ limbs.axes, np.tile(np.eye(3), (len(limbs), 1, 1)),
                                   atol=1e-12)  # fmt: skip
        assert np.linalg.det(limbs.axes) == pytest.approx(1.0)
        along = np.einsum("l,la->la", limbs.lengths, limbs.axes[:, :, 2])
        np.testing.assert_allclose(along, limbs.ends - limbs.starts, atol=1e-12)
    toes = BODY.limbs.axes[BODY.limbs.names.index("Toes_L")]  # this bone points ahead in the neutral pose
    np.testing.assert_allclose(toes.T, [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(2))
def test_points_of_the_limbs_lie_on_the_skin(seed):
    rng = np.random.default_rng(seed)
    pose = 0.3 * rng.standard_normal(len(BODY.skeleton.dof_names))
    surface, frames = person_surface(BODY), forward(BODY.skeleton, pose[None])
    points = surface_points(BODY, pose, 4000, rng)
    away = residuals(BODY.skeleton, surface, pose, points, "distance", attach(surface, frames, points))
    assert np.median(np.abs(away)) < 0.01  # as for the person, along a limb
    # a limb's rounded end is as high as the limb is thin, of which the skin covers the overhang
    assert away.max() < (1.0 - OVERHANG) * BODY.limbs.radii.min(axis=2).max()
