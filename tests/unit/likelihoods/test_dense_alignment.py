"""Dense alignment: surface elements, derivatives, the background model and occluders."""

import numpy as np
import pytest
from dense_walker import third_frame, tracked, walker

from tests.oracles import alignment as oracle
from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
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
ELEMENTS = surface_elements(BODY.limbs)


def walking_pose(seed=0):
    pose = 0.25 * np.random.default_rng(seed).standard_normal(25)
    pose[:3] = 0.0, 0.0, 0.95
    return pose


def frames_of(pose):
    return forward(BODY.skeleton, pose[None])


@pytest.mark.parametrize("n_frames", [1, 2, 5, 50])
def test_medians_are_identical_to_those_of_numpy(n_frames):
    rng = np.random.default_rng(n_frames)
    levels = (255.0 * rng.random((n_frames, 400))).astype(np.float32).astype(np.float64)
    levels[1:][rng.random((n_frames - 1, 400)) < 0.4] = np.nan
    np.testing.assert_array_equal(_median(levels), np.nanmedian(levels, axis=0))


def test_persistent_levels_are_near_the_first_level_or_the_median():
    """The mean of the levels near the median, or near the first one if these are at least as many or ENOUGH_FRAMES."""
    rng, tolerance = np.random.default_rng(0), 8.0
    stack = np.full((30, 70, 6), 100.0) + rng.uniform(-3.0, 3.0, (30, 70, 6))
    n_occluded = rng.integers(0, 30, (70, 6))
    stack[np.arange(30)[:, None, None] < n_occluded] += 60.0  # an object in the first images
    stack, selected = stack.astype(np.float32), rng.random((70, 6)) < 0.9
    persistent = _persistent_levels(stack, selected, tolerance)
    for row, column in np.argwhere(selected):
        levels = stack[:, row, column].astype(np.float64)
        near_first, near_median = (np.abs(levels - level) < tolerance for level in (levels[0], np.median(levels)))
        first_persists = near_first.sum() >= min(near_median.sum(), ENOUGH_FRAMES)
        expected = levels[near_first if first_persists else near_median].mean()
        np.testing.assert_allclose(persistent[row, column], expected, rtol=1e-12)
    assert (persistent[~selected] == 0.0).all()


def test_surface_elements_lie_on_their_limbs_and_face_outwards():
    limbs = BODY.limbs
    for k in range(len(limbs)):
        on_limb = ELEMENTS.limbs == k
        points, normals = ELEMENTS.points[on_limb], ELEMENTS.normals[on_limb]
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
def test_visible_elements_are_those_that_no_limb_occludes(seed):
    pose = walking_pose(seed)
    elements = project_elements(ELEMENTS, frames_of(pose), CAMERA)
    visible = visible_elements(elements, SHAPE, 0.3)
    texture = render.clothes(BODY, np.random.default_rng(0), 1.0)
    background = np.full(SHAPE, -1000.0)
    scene = render.RenderedScene(BODY, CAMERA, texture, background)
    body_pixels = render.render(scene, pose) > -500.0
    x, y = np.rint(elements.pixels[visible]).astype(int).T
    assert body_pixels[y, x].mean() > 0.97
    tested = np.flatnonzero(elements.facing > 0.3)[::5]
    hidden = np.array([_is_occluded(CAMERA.position, elements.points[i], ELEMENTS.limbs[i], pose) for i in tested])
    assert hidden.any()
    assert np.isin(tested[hidden], visible).mean() < 0.15  # limbs at a similar depth do not occlude
    assert np.isin(tested[~hidden], visible).mean() > 0.6  # elements near the outline of an occluding limb are omitted


def _is_occluded(centre, point, limb, pose):
    """Return whether the line of sight comes within 0.9 mean radii of another limb's axis."""
    frames, limbs = frames_of(pose), BODY.limbs
    for k in range(len(limbs)):
        if k == limb:
            continue
        rotation, origin = frames.rotations[0][limbs.joints[k]], frames.positions[0][limbs.joints[k]]
        start, end = rotation @ limbs.starts[k] + origin, rotation @ limbs.ends[k] + origin
        u = np.linspace(0.0, 1.0, 21)[:, None]
        axis, radii = start + u * (end - start), limbs.radii[k].mean(axis=1)
        sight = point - centre
        s = np.clip((axis - centre) @ sight / (sight @ sight), 0.0, 0.97)[:, None]
        distances = np.linalg.norm(centre + s * sight - axis, axis=1)
        if (distances < 0.9 * (radii[0] + (radii[1] - radii[0]) * u[:, 0])).any():
            return True
    return False


def test_slopes_are_the_derivatives_of_projected_elements():
    pose, gradients = walking_pose(3), np.random.default_rng(0).standard_normal((len(ELEMENTS.limbs), 2))
    frames = frames_of(pose)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames)
    elements = project_elements(ELEMENTS, frames, CAMERA)
    forces = oracle.pixel_forces(CAMERA, elements.points, gradients)
    slopes = oracle.slopes(motion, elements.points, forces, ELEMENTS.joints)
    for k in range(25):
        step = np.zeros(25)
        step[k] = 1e-6
        forward_pixels, backward_pixels = (
            project_elements(ELEMENTS, frames_of(pose + sign * step), CAMERA).pixels for sign in (1, -1)
        )
        expected = ((forward_pixels - backward_pixels) / 2e-6 * gradients).sum(axis=1)
        np.testing.assert_allclose(slopes[:, k], expected, atol=1e-4 * max(1.0, np.abs(expected).max()))


def test_the_gradient_is_the_derivative_of_the_loss():
    rng = np.random.default_rng(1)
    pose = walking_pose(2)
    motion = point_motion(BODY.skeleton, dof_mask(BODY.skeleton), pose, frames_of(pose))
    points, joints = 0.5 * rng.standard_normal((40, 3)), rng.integers(0, 15, 40)
    gradients, errors, counts = rng.standard_normal((40, 2)), 2.0 * rng.standard_normal(40), rng.integers(0, 2, 40)
    slopes = oracle.slopes(motion, points, oracle.pixel_forces(CAMERA, points, gradients), joints)

    def residuals(step):
        return Residuals(errors + slopes @ step, gradients, points, joints, counts.astype(float), 2.0)

    gradient, curvature = residuals(np.zeros(25)).normal_equations(motion, CAMERA)
    unit = 1e-6 * np.eye(25)
    expected = [(residuals(step).loss - residuals(-step).loss) / 2e-6 for step in unit]
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-5)
    assert np.linalg.eigvalsh(curvature).min() > -1e-9


def test_contour_samples_have_their_distance_from_the_limb():
    pose = walking_pose(1)
    frames = frames_of(pose)
    on_contour, outside_contour = (contour_samples(BODY.limbs, frames, CAMERA, (d,))[2] for d in (0.0, 8.0))
    distances = np.linalg.norm(outside_contour - on_contour, axis=1)
    np.testing.assert_allclose(distances, 8.0, atol=0.9)  # less for limbs along the line of sight
    mask = person_mask(BODY, CAMERA, frames, SHAPE)
    x, y = np.rint(outside_contour).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < 320) & (y < 240)
    fraction_on_other_limbs = mask[y[inside], x[inside]].mean()
    x, y = np.rint(on_contour).astype(int).T
    assert fraction_on_other_limbs < 0.6 < mask[y[inside], x[inside]].mean()


def test_interpolation_of_a_linear_image_is_exact():
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


def test_the_background_is_observed_behind_a_leaving_and_not_behind_a_standing_person():
    background = np.tile(np.linspace(60.0, 160.0, 80), (60, 1))
    standing, leaving = block(slice(20, 50), slice(15, 25)), block(slice(20, 50), slice(50, 60))
    images = []
    for i in range(20):
        image = background.copy()
        image[standing] = 220.0
        if i < 4:
            image[leaving] = 220.0
        if i == 0:
            image[:10, :10] = 250.0  # an object in the first frame only
        images.append(noisy(image, i))
    model = initial_background(images, standing | leaving)
    uncovered = block(slice(22, 48), slice(52, 58))
    assert model.observed[uncovered].all()
    np.testing.assert_allclose(model.level[uncovered], background[uncovered], atol=6.0)
    assert not model.observed[standing].any()
    np.testing.assert_allclose(model.level[:10, :10], background[:10, :10], atol=6.0)
    assert 2.0 < model.noise < 4.0
    ratio = model.log_ratio(images[0], 0.05)
    assert np.median(ratio[uncovered]) > 1.0
    assert np.median(ratio[2:8, 30:70]) < -1.0
    assert (ratio[standing] == 0.0).all()


def test_the_background_is_refitted_outside_of_the_person():
    background, images, masks = np.tile(np.linspace(60.0, 160.0, 80), (60, 1)), [], []
    for i in range(12):
        mask = block(slice(10, 50), slice(5 + 5 * i, 13 + 5 * i)) | block(slice(30, 34), slice(30, 34))
        image = background.copy()
        image[mask] = 240.0
        images.append(noisy(image, i))
        masks.append(mask)
    model = refitted_background(images, masks)
    assert model.observed.mean() > 0.9
    assert not model.observed[31:33, 31:33].any()
    np.testing.assert_allclose(model.level[model.observed], background[model.observed], atol=8.0)


def test_the_background_is_updated_except_for_outliers():
    images = [noisy(np.full((60, 80), 100.0), i) for i in range(3)]
    person = block(slice(20, 40), slice(30, 50))
    model = initial_background(images, person)
    image = images[0].copy()
    image[:10] = 200.0
    updated = model.updated(image, block(slice(20, 40), slice(10, 30)))
    assert updated.observed[30, 45]  # uncovered by the person
    np.testing.assert_allclose(updated.level[:10], model.level[:10])
    assert not model.observed[30, 45]  # the earlier model is unchanged


def board_clip(n=20):
    """Yield images of a standing person of grey level 30 and a passing textured board, and the masks of both."""
    rng = np.random.default_rng(4)
    background, pattern = np.full((120, 200), 110.0), 255.0 * rng.random((70, 24))
    person = block(slice(30, 100), slice(90, 110), (120, 200))
    for i in range(n):
        image, board = background.copy(), np.zeros((120, 200), dtype=bool)
        image[person] = 30.0
        left = 8 * i
        image[35:105, left : left + 24] = pattern
        board[35:105, left : left + 24] = True
        yield noisy(image, i), person, board


def test_a_passing_board_is_tracked_in_front_of_the_person():
    clip = list(board_clip())
    occluders = no_occluders(clip[0][0])
    for image, standing, board in clip:
        occluders = occluders.tracked(image, np.abs(image - 110.0) > 15.0, standing, standing)
        overlap = (occluders.mask & board).sum() / (occluders.mask | board).sum()
        assert overlap > 0.85
        assert (occluders.mask & standing & ~board).sum() < 60


def test_an_outstretched_arm_is_not_an_occluder():
    clip = list(board_clip(3))
    image, person, _ = clip[0]
    arm = block(slice(40, 52), slice(110, 160), (120, 200))
    assert arm.sum() > MIN_OCCLUDER_PX
    image = np.where(arm | person, 30.0, 110.0).astype(np.float32)
    assert not no_occluders(image).tracked(image, arm | person, person, person).mask.any()


def test_the_true_pose_has_the_highest_likelihood():
    frame_likelihood, truth = third_frame()
    rng = np.random.default_rng(0)
    perturbed = truth + np.where(np.arange(25) < 3, 0.03, 0.1) * rng.standard_normal((40, 25))
    log_prob = frame_likelihood.evaluate(np.repeat(truth[None], 41, axis=0), np.vstack([truth, perturbed])).log_prob
    assert (log_prob[0] > log_prob[1:]).all()


def test_the_gradient_points_towards_the_true_pose():
    frame_likelihood, truth = third_frame()
    assert isinstance(frame_likelihood, DifferentiableLikelihood)
    assert frame_likelihood.informative
    for seed in range(5):
        offset = np.where(np.arange(25) < 3, 0.02, 0.04) * np.random.default_rng(seed).standard_normal(25)
        for level in range(frame_likelihood.n_levels):
            derivatives = frame_likelihood.derivatives(truth + offset, level)
            assert derivatives.gradient @ -offset > 0.0
            assert np.linalg.eigvalsh(derivatives.curvature).min() > -1e-6
        evaluated = frame_likelihood.evaluate(truth[None], (truth + offset)[None]).log_prob
        np.testing.assert_array_equal(evaluated, [derivatives.log_prob])  # of the finest level


def test_a_displaced_limb_increases_the_loss_of_its_joints():
    (frame_likelihood, truth), skeleton = third_frame(), BODY.skeleton
    moved = truth.copy()
    moved[skeleton.dof("left_shoulder_flexion")] += 0.8
    true_loss, moved_loss = frame_likelihood.mean_loss(truth), frame_likelihood.mean_loss(moved)
    ratio = moved_loss / true_loss
    arm = [skeleton.joint("left_shoulder"), skeleton.joint("left_elbow")]
    assert (ratio[arm] > 1.3).all()
    assert ratio[arm].min() > ratio[skeleton.joint("pelvis")] > 1.0
    np.testing.assert_allclose(ratio[skeleton.joint("right_knee")], 1.0, atol=0.2)


def test_refitting_to_tracked_frames_makes_the_first_frame_informative():
    frames = tracked()[1]
    likelihood = DenseAlignment(walker().body, FrameCache(walker()))
    assert isinstance(likelihood, Refittable)
    refitted = likelihood.refitted(frames[0], {frame.index: frame.truth.pose for frame in frames})
    assert refitted.prepare(None, frames[0]).informative
    assert not likelihood.prepare(None, frames[0]).informative
