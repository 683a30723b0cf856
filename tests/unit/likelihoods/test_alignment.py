"""Dense alignment: cells against ray casting, slopes against differences, scene and occluders against made-up clips."""

import numpy as np
import pytest
from dense_walker import third_frame, tracked, walker

from tests.oracles import alignment as oracle
from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import DifferentiableLikelihood, Refittable
from workbench.datasets.rendering import render
from workbench.likelihoods.dense.background_model import (
    ENOUGH_FRAMES,
    MIN_OCCLUDER_PX,
    _median,
    _persistent_levels,
    initial_background,
    no_occluders,
    refitted_background,
)
from workbench.likelihoods.dense.dense_alignment import DenseAlignment
from workbench.likelihoods.dense.surface_elements import (
    contour_samples,
    dof_mask,
    point_motion,
    project_elements,
    surface_elements,
    visible_elements,
)
from workbench.likelihoods.dense.view_likelihood import Residuals, interpolate, person_mask, smoothed_image

BODY = person(from_height(1.75))
CAMERA = plain_camera(320, 240, 330.0, (3.2, -0.9, 0.9), (0.0, 0.0, 0.9))
SHAPE = (240, 320)
CELLS = surface_elements(BODY.limbs)


def walking_pose(seed=0):
    pose = 0.25 * np.random.default_rng(seed).standard_normal(25)
    pose[:3] = 0.0, 0.0, 0.95
    return pose


def frames_of(pose):
    return forward(BODY.skeleton, pose[None])


@pytest.mark.parametrize("n_frames", [1, 2, 5, 50])
def test_medians_are_numpys_to_the_last_bit(n_frames):
    rng = np.random.default_rng(n_frames)
    levels = (255.0 * rng.random((n_frames, 400))).astype(np.float32).astype(np.float64)
    levels[1:][rng.random((n_frames - 1, 400)) < 0.4] = np.nan
    np.testing.assert_array_equal(_median(levels), np.nanmedian(levels, axis=0))


def test_what_lasts_is_the_first_level_or_the_median_where_that_is_seen_more_often():
    """Plainly: the mean of what agrees with the first image, or with the median where that agrees with more, and the
    first with fewer than OWN."""
    rng, apart = np.random.default_rng(0), 8.0
    stack = np.full((30, 70, 6), 100.0) + rng.uniform(-3.0, 3.0, (30, 70, 6))
    passed = rng.integers(0, 30, (70, 6))
    stack[np.arange(30)[:, None, None] < passed] += 60.0  # in so many first images something stands there
    stack, wanted = stack.astype(np.float32), rng.random((70, 6)) < 0.9
    found = _persistent_levels(stack, wanted, apart)
    for row, column in np.argwhere(wanted):
        levels = stack[:, row, column].astype(np.float64)
        as_first, as_median = (np.abs(levels - each) < apart for each in (levels[0], np.median(levels)))
        own = as_first.sum() >= min(as_median.sum(), ENOUGH_FRAMES)
        np.testing.assert_allclose(found[row, column], levels[as_first if own else as_median].mean(), rtol=1e-12)
    assert (found[~wanted] == 0.0).all()


def test_cells_lie_on_their_limbs_and_face_outwards():
    limbs = BODY.limbs
    for k in range(len(limbs)):
        own = CELLS.limbs == k
        points, normals = CELLS.points[own], CELLS.normals[own]
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
        local = (points - limbs.starts[k]) @ limbs.axes[k]
        if limbs.spheres[k]:
            np.testing.assert_allclose(points - limbs.starts[k], limbs.radii[k, 0, 0] * normals, atol=1e-12)
            continue
        u = local[:, 2:] / limbs.lengths[k]
        radii = (1.0 - u) * limbs.radii[k, 0] + u * limbs.radii[k, 1]
        np.testing.assert_allclose(((local[:, :2] / radii) ** 2).sum(axis=1), 1.0, atol=1e-12)
        assert ((u > 0.0) & (u < 1.0)).all()
        assert ((normals @ limbs.axes[k])[:, :2] * local[:, :2] > -1e-12).all()


@pytest.mark.parametrize("seed", range(3))
def test_what_counts_as_visible_is_what_rays_meet_first(seed):
    pose = walking_pose(seed)
    cells = project_elements(CELLS, frames_of(pose), CAMERA)
    shown = visible_elements(cells, SHAPE, 0.3)
    texture = render.clothes(BODY, np.random.default_rng(0), 1.0)
    wall = np.full(SHAPE, -1000.0)
    scene = render.RenderedScene(BODY, CAMERA, texture, wall)
    body_pixels = render.render(scene, pose) > -500.0
    x, y = np.rint(cells.pixels[shown]).astype(int).T
    assert body_pixels[y, x].mean() > 0.97
    some = np.flatnonzero(cells.facing > 0.3)[::5]
    hidden = np.array([_crosses_another(CAMERA.position, cells.points[i], CELLS.limbs[i], pose) for i in some])
    assert hidden.any()
    assert np.isin(some[hidden], shown).mean() < 0.15  # a near limb of the same thickness hides nothing
    assert np.isin(some[~hidden], shown).mean() > 0.6  # beside the outline of what hides, neighbours are left out


def _crosses_another(eye, point, limb, pose):
    """Whether the line of sight meets the axis of another limb closer than nine tenths of its mean radius."""
    frames, limbs = frames_of(pose), BODY.limbs
    for k in range(len(limbs)):
        if k == limb:
            continue
        turned, origin = frames.rotations[0][limbs.joints[k]], frames.positions[0][limbs.joints[k]]
        start, end = turned @ limbs.starts[k] + origin, turned @ limbs.ends[k] + origin
        u = np.linspace(0.0, 1.0, 21)[:, None]
        axis, radii = start + u * (end - start), limbs.radii[k].mean(axis=1)
        s = np.linspace(0.0, 0.97, 200)[:, None, None]
        apart = np.linalg.norm(eye + s * (point - eye) - axis, axis=2)
        if (apart < 0.9 * (radii[0] + (radii[1] - radii[0]) * u[:, 0])).any():
            return True
    return False


def test_slopes_are_the_derivatives_of_pixels_carried_by_the_body():
    pose, gradients = walking_pose(3), np.random.default_rng(0).standard_normal((len(CELLS.limbs), 2))
    frames = frames_of(pose)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames)
    cells = project_elements(CELLS, frames, CAMERA)
    found = oracle.slopes(motion, cells.points, oracle.pixel_forces(CAMERA, cells.points, gradients), CELLS.joints)
    for k in range(25):
        step = np.zeros(25)
        step[k] = 1e-6
        ahead, behind = (project_elements(CELLS, frames_of(pose + way * step), CAMERA).pixels for way in (1, -1))
        expected = ((ahead - behind) / 2e-6 * gradients).sum(axis=1)
        np.testing.assert_allclose(found[:, k], expected, atol=1e-4 * max(1.0, np.abs(expected).max()))


def test_the_loss_and_its_slope_agree():
    rng = np.random.default_rng(1)
    pose = walking_pose(2)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames_of(pose))
    points, joints = 0.5 * rng.standard_normal((40, 3)), rng.integers(0, 15, 40)
    gradients, misses, counts = rng.standard_normal((40, 2)), 2.0 * rng.standard_normal(40), rng.integers(0, 2, 40)
    slopes = oracle.slopes(motion, points, oracle.pixel_forces(CAMERA, points, gradients), joints)

    def residuals(step):
        return Residuals(misses + slopes @ step, gradients, points, joints, counts.astype(float), 2.0)

    gradient, curvature = residuals(np.zeros(25)).normal_equations(motion, CAMERA)
    unit = 1e-6 * np.eye(25)
    expected = [(residuals(step).loss - residuals(-step).loss) / 2e-6 for step in unit]
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-5)
    assert np.linalg.eigvalsh(curvature).min() > -1e-9


def test_points_beside_a_limb_are_as_far_from_it_as_asked():
    pose = walking_pose(1)
    frames = frames_of(pose)
    near, far = (contour_samples(BODY.limbs, frames, CAMERA, (distance,))[2] for distance in (0.0, 8.0))
    np.testing.assert_allclose(np.linalg.norm(far - near, axis=1), 8.0, atol=0.9)  # but where a limb points at us
    mask = person_mask(BODY, CAMERA, frames, SHAPE)
    x, y = np.rint(far).astype(int).T
    kept = (x >= 0) & (y >= 0) & (x < 320) & (y < 240)
    on_others = mask[y[kept], x[kept]].mean()
    x, y = np.rint(near).astype(int).T
    assert on_others < 0.6 < mask[y[kept], x[kept]].mean()


def test_pictures_have_the_slope_of_a_plane():
    rows, columns = np.mgrid[:40, :50].astype(np.float32)
    values, gradients = interpolate(
        smoothed_image(3.0 * columns - 2.0 * rows, 1.5), np.array([[20.25, 18.5], [30.0, 20.75]])
    )
    np.testing.assert_allclose(values, [3.0 * 20.25 - 2.0 * 18.5, 90.0 - 41.5], atol=1e-3)
    np.testing.assert_allclose(gradients, [[3.0, -2.0], [3.0, -2.0]], atol=1e-4)


def block(rows, columns, shape=(60, 80)):
    mask = np.zeros(shape, dtype=bool)
    mask[rows, columns] = True
    return mask


def noisy(image, seed):
    return (image + np.random.default_rng(seed).normal(0.0, 3.0, image.shape)).astype(np.float32)


def test_the_scene_is_found_about_and_behind_who_leaves_and_not_behind_who_stays():
    wall = np.tile(np.linspace(60.0, 160.0, 80), (60, 1))
    stays, leaves = block(slice(20, 50), slice(15, 25)), block(slice(20, 50), slice(50, 60))
    images = []
    for i in range(20):
        image = wall.copy()
        image[stays] = 220.0
        if i < 4:
            image[leaves] = 220.0
        if i == 0:
            image[:10, :10] = 250.0  # something at the edge, gone in the next frame
        images.append(noisy(image, i))
    found = initial_background(images, stays | leaves)
    middle = block(slice(22, 48), slice(52, 58))
    assert found.observed[middle].all()
    np.testing.assert_allclose(found.level[middle], wall[middle], atol=6.0)
    assert not found.observed[stays].any()
    np.testing.assert_allclose(found.level[:10, :10], wall[:10, :10], atol=6.0)
    assert 2.0 < found.noise < 4.0
    ratio = found.log_ratio(images[0], 0.05)
    assert np.median(ratio[middle]) > 1.0
    assert np.median(ratio[2:8, 30:70]) < -1.0
    assert (ratio[stays] == 0.0).all()


def test_the_scene_is_learned_where_the_person_was_not():
    wall, images, masks = np.tile(np.linspace(60.0, 160.0, 80), (60, 1)), [], []
    for i in range(12):
        mask = block(slice(10, 50), slice(5 + 5 * i, 13 + 5 * i)) | block(slice(30, 34), slice(30, 34))
        image = wall.copy()
        image[mask] = 240.0
        images.append(noisy(image, i))
        masks.append(mask)
    found = refitted_background(images, masks)
    assert found.observed.mean() > 0.9
    assert not found.observed[31:33, 31:33].any()
    np.testing.assert_allclose(found.level[found.observed], wall[found.observed], atol=8.0)


def test_a_scene_goes_on_learning_but_not_of_what_is_not_it():
    images = [noisy(np.full((60, 80), 100.0), i) for i in range(3)]
    person = block(slice(20, 40), slice(30, 50))
    scene = initial_background(images, person)
    shown = images[0].copy()
    shown[:10] = 200.0
    later = scene.updated(shown, block(slice(20, 40), slice(10, 30)))
    assert later.observed[30, 45]  # the person has left from here
    np.testing.assert_allclose(later.level[:10], scene.level[:10])
    assert not scene.observed[30, 45]  # and what was known before stays as it was


def board_clip(n=20):
    """Images of a wall, a person of grey 30 who stands, and a board with a pattern that passes before them."""
    rng = np.random.default_rng(4)
    wall, pattern = np.full((120, 200), 110.0), 255.0 * rng.random((70, 24))
    person = block(slice(30, 100), slice(90, 110), (120, 200))
    for i in range(n):
        image, board = wall.copy(), np.zeros((120, 200), dtype=bool)
        image[person] = 30.0
        left = 8 * i
        image[35:105, left : left + 24] = pattern
        board[35:105, left : left + 24] = True
        yield noisy(image, i), person, board


def test_what_passes_is_followed_over_the_person_and_beyond():
    clip = list(board_clip())
    passing = no_occluders(clip[0][0])
    for image, standing, board in clip:
        unknown = standing
        passing = passing.tracked(image, np.abs(image - 110.0) > 15.0, standing, unknown)
        shared = (passing.mask & board).sum() / (passing.mask | board).sum()
        assert shared > 0.85
        assert (passing.mask & standing & ~board).sum() < 60


def test_an_arm_that_reaches_out_does_not_pass():
    clip = list(board_clip(3))
    image, person, _ = clip[0]
    arm = block(slice(40, 52), slice(110, 160), (120, 200))
    assert arm.sum() > MIN_OCCLUDER_PX
    image = np.where(arm | person, 30.0, 110.0).astype(np.float32)
    assert not no_occluders(image).tracked(image, arm | person, person, person).mask.any()


def test_the_truth_is_likelier_than_what_is_beside_it():
    frame_likelihood, truth = third_frame()
    rng = np.random.default_rng(0)
    off = truth + np.where(np.arange(25) < 3, 0.03, 0.1) * rng.standard_normal((40, 25))
    heights = frame_likelihood.evaluate(np.repeat(truth[None], 41, axis=0), np.vstack([truth, off])).log_prob
    assert (heights[0] > heights[1:]).all()


def test_its_slope_points_back_to_the_truth():
    frame_likelihood, truth = third_frame()
    assert isinstance(frame_likelihood, DifferentiableLikelihood)
    assert frame_likelihood.informative
    for seed in range(5):
        off = np.where(np.arange(25) < 3, 0.02, 0.04) * np.random.default_rng(seed).standard_normal(25)
        for level in range(frame_likelihood.n_levels):
            slope = frame_likelihood.derivatives(truth + off, level)
            assert slope.gradient @ -off > 0.0
            assert np.linalg.eigvalsh(slope.curvature).min() > -1e-6
        judged = frame_likelihood.evaluate(truth[None], (truth + off)[None]).log_prob
        np.testing.assert_array_equal(
            judged, [frame_likelihood.derivatives(truth + off, frame_likelihood.n_levels - 1).log_prob]
        )


def test_a_limb_beside_its_image_is_a_misfit_of_what_carries_it_alone():
    (frame_likelihood, truth), skeleton = third_frame(), BODY.skeleton
    off = truth.copy()
    off[skeleton.dof("left_shoulder_flexion")] += 0.8
    fits, misses = frame_likelihood.mean_loss(truth), frame_likelihood.mean_loss(off)
    worse = misses / fits
    arm = [skeleton.joint("left_shoulder"), skeleton.joint("left_elbow")]
    assert (worse[arm] > 1.3).all()
    assert worse[arm].min() > worse[skeleton.joint("pelvis")] > 1.0
    np.testing.assert_allclose(worse[skeleton.joint("right_knee")], 1.0, atol=0.2)


def test_a_clip_that_was_tracked_teaches_more_of_the_scene():
    frames = tracked()[1]
    likelihood = DenseAlignment(walker().body, FrameCache(walker()))
    assert isinstance(likelihood, Refittable)
    again = likelihood.refitted(frames[0], {frame.index: frame.truth.pose for frame in frames})
    assert again.prepare(None, frames[0]).informative
    assert not likelihood.prepare(None, frames[0]).informative
