"""The image as layers: the kernels against NumPy, and likelihoods of limbs in a rendered image."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from dense_walker import third_frame

from tests.oracles import alignment as oracle
from workbench.body.kinematics import descendants, forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.likelihood import DenseLikelihood
from workbench.likelihoods.dense.layer_rendering import (
    LayerImage,
    layer_log_ratios,
    render_layer,
    surface_facets,
)
from workbench.likelihoods.dense.surface_elements import surface_elements
from workbench.likelihoods.dense.view_likelihood import person_mask

BODY = person(from_height(1.75))
SKELETON = BODY.skeleton
SHAPE = (96, 128)
CAMERA = plain_camera(128, 96, 130.0, (3.2, -0.9, 0.9), (0.0, 0.0, 0.9))
ELEMENTS = surface_elements(BODY.limbs)
FACETS = surface_facets(BODY.limbs, ELEMENTS)
EMPTY = np.full(SHAPE, -1), np.full(SHAPE, np.inf)


def poses(n, seed=0):
    sampled = 0.4 * np.random.default_rng(seed).standard_normal((n, 25))
    sampled[:, :3] = 0.0, 0.0, 0.95
    return sampled


def joints_from(name):
    joint = SKELETON.joint(name)
    return descendants(SKELETON)[joint] | (np.arange(len(SKELETON.names)) == joint)


@pytest.mark.parametrize("seed", range(2))
def test_layers_are_rendered_as_in_numpy(seed):
    frames = forward(SKELETON, poses(1, seed))
    elements, depths = render_layer(FACETS, frames, CAMERA, SHAPE)
    expected, expected_depths = oracle.render_layer(FACETS, frames, CAMERA, EMPTY)
    assert (elements != expected).mean() < 1e-3  # pixel centres on an edge, by rounding
    same = elements == expected
    np.testing.assert_allclose(depths[same], expected_depths[same], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_layer_covers_the_patches_of_the_limbs(seed):
    frames, shape = forward(SKELETON, poses(1, seed)), (480, 640)
    camera = CAMERA.scaled(5.0)
    covered, mask = render_layer(FACETS, frames, camera, shape)[0] >= 0, person_mask(BODY, camera, frames, shape)
    assert (covered & mask).sum() > 0.93 * (covered | mask).sum()  # patches are flat and rounded to pixels


def test_a_body_partly_outside_of_the_image_is_rendered_as_in_numpy():
    pose = poses(1)
    pose[:, 0] += 2.4  # close to the camera and partly outside of the image
    frames = forward(SKELETON, pose)
    elements, _ = render_layer(FACETS, frames, CAMERA, SHAPE)
    assert (elements != oracle.render_layer(FACETS, frames, CAMERA, EMPTY)[0]).mean() < 1e-3
    assert (elements >= 0).any()
    behind = poses(1)
    behind[:, 0] += 30.0
    assert (render_layer(FACETS, forward(SKELETON, behind), CAMERA, SHAPE)[0] == -1).all()


def layer_image(seed=0):
    rng = np.random.default_rng(seed)
    n = np.where(rng.random(len(ELEMENTS.joints)) < 0.2, 0.0, rng.integers(1, 9, len(ELEMENTS.joints)))
    image = rng.uniform(0.0, 255.0, SHAPE).astype(np.float32)
    ratio = rng.uniform(-3.0, 3.0, SHAPE).astype(np.float32)
    return LayerImage(image, ratio, rng.random(SHAPE) < 0.9, rng.uniform(0.0, 255.0, len(n)), n.astype(float), 10.0)


def test_log_ratios_are_differences_of_layers_in_numpy():
    arm_joints, candidates, image = joints_from("left_shoulder"), poses(5, 1), layer_image()
    candidates[1:] = candidates[0]
    arm_dofs = [k for k, name in enumerate(SKELETON.dof_names) if name.startswith(("left_shoulder", "left_elbow"))]
    candidates[:, arm_dofs] = 0.6 * np.random.default_rng(2).standard_normal((5, len(arm_dofs)))
    frames = forward(SKELETON, candidates)
    behind = render_layer(FACETS.on_joints(~arm_joints), frames, CAMERA, SHAPE)
    ratios = layer_log_ratios(behind, FACETS.on_joints(arm_joints), frames, CAMERA, image)
    for i in range(len(candidates)):
        frame = forward(SKELETON, candidates[i : i + 1])
        layer = oracle.render_layer(FACETS.on_joints(arm_joints), frame, CAMERA, behind)
        expected = oracle.layer_log_ratio(layer, image) - oracle.layer_log_ratio(behind, image)
        assert ratios[i] == pytest.approx(expected, abs=4.0)
    assert np.ptp(ratios) > 20.0
    all_limbs = layer_log_ratios(EMPTY, FACETS, frames, CAMERA, image)
    without_arm = layer_log_ratios(EMPTY, FACETS.on_joints(~arm_joints), frames, CAMERA, image)
    np.testing.assert_allclose(all_limbs, without_arm + ratios, atol=1e-8)  # the log ratios are additive


def test_log_ratios_do_not_depend_on_the_number_of_threads(monkeypatch):
    frames, ratios = forward(SKELETON, poses(40)), []
    for threads in (1, 2):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        ratios.append(layer_log_ratios(EMPTY, FACETS, frames, CAMERA, layer_image()))
    np.testing.assert_array_equal(*ratios)


@pytest.mark.parametrize("limb", ["left_shoulder", "right_shoulder", "left_hip", "right_hip"])
def test_a_limb_has_the_highest_likelihood_in_its_true_pose(limb):
    frame_likelihood, truth = third_frame()
    assert isinstance(frame_likelihood, DenseLikelihood)
    limb_dofs = [k for k, name in enumerate(SKELETON.dof_names) if name.startswith(limb)]
    rng, candidates = np.random.default_rng(0), np.repeat(truth[None], 40, axis=0)
    size = (39, len(limb_dofs))
    candidates[1:, limb_dofs] += rng.choice([-1.0, 1.0], size) * rng.uniform(0.4, 0.9, size)
    ratios = frame_likelihood.compare(candidates, joints_from(limb))
    assert ratios[0] > ratios[1:].max() + 5.0


def test_omitting_a_visible_arm_decreases_the_likelihood():
    frame_likelihood, truth = third_frame()
    all_joints = np.ones(len(SKELETON.names), dtype=bool)
    arms = [joints_from(f"{side}_shoulder") for side in ("left", "right")]
    visible_arm = max(arms, key=lambda arm: frame_likelihood.compare(truth[None], arm)[0])
    without = frame_likelihood.compare(truth[None], ~visible_arm)[0]
    assert frame_likelihood.compare(truth[None], all_joints)[0] > without + 5.0


def test_occluded_pixels_have_no_likelihood():
    frame_likelihood, truth = third_frame()
    (view_likelihood, template), = frame_likelihood.view_likelihoods  # fmt: skip
    occluded_view = replace(view_likelihood, unoccluded=np.zeros_like(view_likelihood.unoccluded))
    occluded = replace(frame_likelihood, view_likelihoods=((occluded_view, template),))
    assert occluded.compare(truth[None], joints_from("left_hip"))[0] == 0.0
