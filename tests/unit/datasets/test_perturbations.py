"""Perturbations of the person, the calibration and the initial pose of rendered datasets: kinds and sizes."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person, skeleton_limbs
from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.datasets.points import Points
from workbench.datasets.rendering.perturbations import DEFAULT_SIZES, calibration_error, miscalibrated
from workbench.datasets.rendering.subject import draw_subject, height_of
from workbench.datasets.rendering.visible import first_depth
from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic

SMALL = {"n_frames": 3, "width": 160, "height": 120, "focal_px": 175.0}
DATASETS = {
    "synthetic": lambda **more: Synthetic(**SMALL, person_px=70.0, **more),
    "points": lambda **more: Points(**SMALL, n_points=100, images=True, initialization="perturbed_truth", **more),
    "stereo": lambda **more: Stereo(
        **{**SMALL, "n_frames": 2}, baseline_m=0.4, initialization="perturbed_truth", **more
    ),
}

NONE = dict.fromkeys(DEFAULT_SIZES, 0.0)


def only(**sizes):
    return {"perturb": False, "perturbations": sizes}


def images(dataset):
    return np.stack([frame.views[0].image for frame in dataset.frames()])


@pytest.mark.parametrize("create", DATASETS.values(), ids=DATASETS)
def test_person_and_camera_are_perturbed_by_default(create):
    dataset = create()
    info, frame = dataset.info, next(dataset.frames())
    model_joints = joints(person_skeleton(info.shape), frame.truth.pose[None])[0]
    errors = np.linalg.norm(frame.truth.joints - model_joints, axis=1)
    assert 0.002 < errors.max() < 0.08  # three bones of half a metre in a chain, with errors of at most 3 %
    (true_camera, *_), (camera, *_) = frame.truth.cameras, info.cameras
    assert camera is frame.views[0].camera
    assert not np.array_equal(camera.matrix, true_camera.matrix)
    assert {"length_thigh", "radius_calf", "clothes_m", "camera_focal"} <= set(info.perturbations)


@pytest.mark.parametrize("create", DATASETS.values(), ids=DATASETS)
def test_an_exact_dataset_has_no_perturbations(create):
    dataset = create(perturb=False)
    info, frame = dataset.info, next(dataset.frames())
    assert np.array_equal(frame.truth.joints, joints(person_skeleton(info.shape), frame.truth.pose[None])[0])
    assert frame.truth.cameras == ()
    assert not info.perturbations
    assert np.array_equal(info.initial_pose, frame.truth.pose)


def test_every_perturbation_changes_only_its_quantity():
    exact = Synthetic(**SMALL, person_px=70.0, perturb=False)
    for name, size in DEFAULT_SIZES.items():
        dataset = Synthetic(**SMALL, person_px=70.0, **only(**{name: size}))
        images_differ = not np.array_equal(images(dataset), images(exact))
        camera_differs = not np.array_equal(dataset.info.cameras[0].translation, dataset.true_camera.translation)
        start_differs = not np.array_equal(dataset.info.initial_pose, exact.info.initial_pose)
        expected = (name in ("lengths", "radii", "profile", "clothes_m"), "camera" in name, "start" in name)
        assert (images_differ, camera_differs, start_differs) == expected, name


def test_the_subject_has_the_same_height_with_other_lengths_and_radii():
    body = person(from_height(1.8))
    for seed in range(20):
        subject = draw_subject(body, {**NONE, "lengths": 0.03, "radii": 0.1}, seed)
        assert height_of(subject.body.shape) == pytest.approx(height_of(body.shape), abs=1e-12)
        length_factors = [subject.factors[f"length_{name}"][0] for name in ("thigh", "calf", "torso", "forearm")]
        assert np.ptp(length_factors) > 0.001
        assert max(abs(np.log(length_factors))) < 0.061  # 3 %, and the same again to preserve the height
        radius_factors = subject.body.limbs.radii / body.limbs.radii
        assert np.abs(radius_factors - 1.0).max() <= 0.1
        assert radius_factors.std() > 0.02
        left, right = (subject.body.limbs.names.index(f"{side}_thigh") for side in ("left", "right"))
        assert np.array_equal(radius_factors[left], radius_factors[right])


def test_clothes_move_smoothly_with_their_standard_deviation():
    body = person(from_height(1.7))
    subject = draw_subject(body, {**NONE, "clothes_m": 0.005}, 2)
    random_times, frame_times = np.random.default_rng(0).uniform(0.0, 2000.0, 3000), np.arange(300) / 30.0
    radii, consecutive_radii = (
        np.stack([subject.at(t).limbs.radii.mean(axis=2) for t in t_s]) for t_s in (random_times, frame_times)
    )
    clothed = np.array(["head" not in name and "hand" not in name for name in body.limbs.names])
    assert np.array_equal(radii[:, ~clothed], np.broadcast_to(radii[0, ~clothed], radii[:, ~clothed].shape))
    assert radii[:, clothed].std(axis=0) == pytest.approx(0.005, rel=0.1)
    steps = np.abs(np.diff(consecutive_radii, axis=0)).max()
    assert 0.0005 < steps < 0.005  # three waves of at most 2.5 Hz: 5 mm · 2.4 · 2π · 2.5 / 30
    shifts = np.stack([subject.clothes.slid(t) for t in random_times])
    assert shifts[:, clothed].std(axis=0) == pytest.approx(0.005, rel=0.1)


def test_the_calibration_error_has_its_size_and_a_random_direction():
    camera = Synthetic(**SMALL, person_px=70.0, perturb=False).true_camera
    target = camera.position + 5.0 * camera.rotation[2]
    assert miscalibrated(camera, target, 0.0, 0.0, 1) is camera
    assert calibration_error(camera, camera) == {}
    rotations = []
    for seed in range(5):
        calibrated = miscalibrated(camera, target, 0.01, 1.0, seed)
        error = calibration_error(camera, calibrated)
        assert abs(error["camera_focal"][0] - 1.0) == pytest.approx(0.01)
        assert np.linalg.norm(error["camera_principal_point_px"]) == pytest.approx(1.6)
        assert np.linalg.norm(error["camera_place_m"]) == pytest.approx(0.05)
        assert np.linalg.norm(np.degrees(error["camera_turn_rad"])) == pytest.approx(1.0)
        rotations.append(error["camera_turn_rad"])
    assert np.linalg.matrix_rank(rotations) == 3


def test_points_are_reconstructed_with_the_calibrated_camera():
    dataset = Points(n_frames=2, n_points=300, sigma_m=0.0, outlier_fraction=0.0)
    camera, calibrated = dataset.true_camera, dataset.calibrated_camera
    points = next(dataset.frames()).points
    in_camera = calibrated.to_camera(points)
    pixels = calibrated.project(points)
    true_points = (pixels - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]] * in_camera[:, 2:]
    true_points = (np.column_stack([true_points, in_camera[:, 2]]) - camera.translation) @ camera.rotation
    pose, subject = dataset.sequence.motion.poses[0], dataset.sequence.subject
    depth = camera.to_camera(true_points)[:, 2]
    assert np.abs(first_depth(subject.at(0.0), pose, camera, true_points) - depth).max() < 2e-3
    model_distance = np.abs(first_depth(dataset.sequence.body, pose, calibrated, points) - in_camera[:, 2])
    assert np.median(model_distance) > 0.003


def test_the_bones_of_any_skeleton_are_perturbed_at_the_same_height():
    reference = person_skeleton(from_height(1.7))
    skeleton = replace(reference, names=tuple(f"joint_{k}" for k in range(len(reference.names))))
    body = Body(skeleton, from_height(1.7), skeleton_limbs(skeleton))
    subject = draw_subject(body, {**NONE, "lengths": 0.03}, 4)
    perturbed = subject.body.skeleton
    lengths = np.linalg.norm(perturbed.offsets[1:], axis=1) / np.linalg.norm(skeleton.offsets[1:], axis=1)
    assert lengths.std() > 0.005
    assert np.ptp(lengths) < 0.062
    neutral = np.zeros((1, len(skeleton.dof_names)))
    heights = [np.ptp(joints(s, neutral)[0, :, 2]) for s in (skeleton, perturbed)]
    assert heights[1] == pytest.approx(heights[0], abs=1e-12)
    ends = [perturbed.names.index(name) for name in subject.body.limbs.names]
    assert subject.body.limbs.ends == pytest.approx(perturbed.offsets[ends])


def test_rendered_images_do_not_depend_on_the_feet_of_the_model():
    with_feet, without_feet = DATASETS["synthetic"](neck_and_feet=True), DATASETS["synthetic"]()
    assert len(with_feet.info.body.limbs) == 15
    assert without_feet.info.body is None
    assert with_feet._key() == without_feet._key()
    assert np.array_equal(images(with_feet), images(without_feet))
