"""The image as layers: the kernels against plain NumPy, and a limb that is somewhere else against a rendered person."""

from dataclasses import replace

import numpy as np
import pytest
from dense_walker import third_frame

from tests.oracles import alignment as oracle
from workbench.body.camera import plain_camera
from workbench.body.kinematics import descendants, forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
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
CELLS = surface_elements(BODY.limbs)
FACETS = surface_facets(BODY.limbs, CELLS)
NOTHING = np.full(SHAPE, -1), np.full(SHAPE, np.inf)


def poses(n, seed=0):
    found = 0.4 * np.random.default_rng(seed).standard_normal((n, 25))
    found[:, :3] = 0.0, 0.0, 0.95
    return found


def carried(name):
    joint = SKELETON.joint(name)
    return descendants(SKELETON)[joint] | (np.arange(len(SKELETON.names)) == joint)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_what_is_drawn_is_what_numpy_draws(seed):
    frames = forward(SKELETON, poses(1, seed))
    cells, depths = render_layer(FACETS, frames, CAMERA, SHAPE)
    expected, expected_depths = oracle.render_layer(FACETS, frames, CAMERA, NOTHING)
    assert (cells != expected).mean() < 1e-3  # a pixel's middle may lie on an edge, but for rounding
    same = cells == expected
    np.testing.assert_allclose(depths[same], expected_depths[same], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_drawn_is_where_the_limbs_patches_are(seed):
    frames, shape = forward(SKELETON, poses(1, seed)), (480, 640)
    camera = CAMERA.scaled(5.0)
    covered, mask = render_layer(FACETS, frames, camera, shape)[0] >= 0, person_mask(BODY, camera, frames, shape)
    assert (covered & mask).sum() > 0.93 * (covered | mask).sum()  # patches are flat, and round to whole pixels


def test_what_is_partly_out_of_sight_is_drawn_as_far_as_it_is_seen():
    pose = poses(1)
    pose[:, 0] += 2.4  # close to the camera, and partly beside the image
    frames = forward(SKELETON, pose)
    cells, _ = render_layer(FACETS, frames, CAMERA, SHAPE)
    assert (cells != oracle.render_layer(FACETS, frames, CAMERA, NOTHING)[0]).mean() < 1e-3
    assert (cells >= 0).any()
    behind = poses(1)
    behind[:, 0] += 30.0
    assert (render_layer(FACETS, forward(SKELETON, behind), CAMERA, SHAPE)[0] == -1).all()


def shown(seed=0):
    rng = np.random.default_rng(seed)
    n = np.where(rng.random(len(CELLS.joints)) < 0.2, 0.0, rng.integers(1, 9, len(CELLS.joints)))
    image = rng.uniform(0.0, 255.0, SHAPE).astype(np.float32)
    ratio = rng.uniform(-3.0, 3.0, SHAPE).astype(np.float32)
    return LayerImage(image, ratio, rng.random(SHAPE) < 0.9, rng.uniform(0.0, 255.0, len(n)), n.astype(float), 10.0)


@pytest.mark.slow
def test_log_ratios_are_the_difference_of_two_layers_in_numpy():
    moved, tried, what = carried("left_shoulder"), poses(9, 1), shown()
    tried[1:] = tried[0]
    arm = [k for k, name in enumerate(SKELETON.dof_names) if name.startswith(("left_shoulder", "left_elbow"))]
    tried[:, arm] = 0.6 * np.random.default_rng(2).standard_normal((9, len(arm)))
    frames = forward(SKELETON, tried)
    behind = render_layer(FACETS.on_joints(~moved), frames, CAMERA, SHAPE)
    found = layer_log_ratios(behind, FACETS.on_joints(moved), frames, CAMERA, what)
    for i in range(len(tried)):
        layer = oracle.render_layer(FACETS.on_joints(moved), forward(SKELETON, tried[i : i + 1]), CAMERA, behind)
        assert found[i] == pytest.approx(
            oracle.layer_log_ratio(layer, what) - oracle.layer_log_ratio(behind, what), abs=4.0
        )
    assert np.ptp(found) > 20.0
    whole = layer_log_ratios(NOTHING, FACETS, frames, CAMERA, what)
    apart = layer_log_ratios(NOTHING, FACETS.on_joints(~moved), frames, CAMERA, what)
    np.testing.assert_allclose(whole, apart + found, atol=1e-8)  # the chain rule


def test_log_ratios_are_the_same_on_any_number_of_threads(monkeypatch):
    import numba

    frames, found = forward(SKELETON, poses(40)), []
    for threads in (1, 2):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        found.append(layer_log_ratios(NOTHING, FACETS, frames, CAMERA, shown()))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("limb", ["left_shoulder", "right_shoulder", "left_hip", "right_hip"])
def test_a_limb_is_likelier_where_it_is_than_elsewhere(limb):
    frame_likelihood, truth = third_frame()
    assert isinstance(frame_likelihood, DenseLikelihood)
    own = [k for k, name in enumerate(SKELETON.dof_names) if name.startswith(limb)]
    rng, tried = np.random.default_rng(0), np.repeat(truth[None], 40, axis=0)
    tried[1:, own] += rng.choice([-1.0, 1.0], (39, len(own))) * rng.uniform(0.4, 0.9, (39, len(own)))
    ratios = frame_likelihood.compare(tried, carried(limb))
    assert ratios[0] > ratios[1:].max() + 5.0


def test_an_arm_that_is_seen_cannot_hide_for_nothing():
    frame_likelihood, truth = third_frame()
    everything = np.ones(len(SKELETON.names), dtype=bool)
    side = max(
        ("left", "right"), key=lambda side: frame_likelihood.compare(truth[None], carried(f"{side}_shoulder"))[0]
    )
    without = frame_likelihood.compare(truth[None], ~carried(f"{side}_shoulder"))[0]
    assert frame_likelihood.compare(truth[None], everything)[0] > without + 5.0


def test_what_passes_before_the_person_says_nothing():
    frame_likelihood, truth = third_frame()
    (sight, known), = frame_likelihood.view_likelihoods  # fmt: skip
    hidden = replace(
        frame_likelihood, view_likelihoods=((replace(sight, unoccluded=np.zeros_like(sight.unoccluded)), known),)
    )
    assert hidden.compare(truth[None], carried("left_hip"))[0] == 0.0
