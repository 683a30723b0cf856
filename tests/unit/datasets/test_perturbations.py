"""What is shown departs from what a tracker is told: by how much, of which kinds, and not at all where it must not."""

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
MADE = {
    "synthetic": lambda **more: Synthetic(**SMALL, person_px=70.0, **more),
    "points": lambda **more: Points(**SMALL, n_points=100, images=True, initialization="perturbed_truth", **more),
    "stereo": lambda **more: Stereo(n_frames=2, width=320, height=240, focal_px=350.0, baseline_m=0.4, **more),
}

NONE = dict.fromkeys(DEFAULT_SIZES, 0.0)


def only(**sizes):
    return {"perturb": False, "perturbations": sizes}


def images(dataset):
    return np.stack([frame.views[0].image for frame in dataset.frames()])


@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_by_default_person_and_camera_are_not_those_told_and_the_truth_is_theirs(made):
    dataset = made()
    known, frame = dataset.info, next(dataset.frames())
    told = joints(person_skeleton(known.shape), frame.truth.pose[None])[0]
    apart = np.linalg.norm(frame.truth.joints - told, axis=1)
    assert 0.002 < apart.max() < 0.08  # bones of half a metre are off by 3 % at most, and three lie one after another
    (true, *_), (camera, *_) = frame.truth.cameras, known.cameras
    assert camera is frame.views[0].camera
    assert not np.array_equal(camera.matrix, true.matrix)
    assert {"length_thigh", "radius_calf", "clothes_m", "camera_focal"} <= set(known.perturbations)


@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_an_exact_scene_tells_the_truth(made):
    dataset = made(perturb=False)
    known, frame = dataset.info, next(dataset.frames())
    assert np.array_equal(frame.truth.joints, joints(person_skeleton(known.shape), frame.truth.pose[None])[0])
    assert frame.truth.cameras == ()
    assert not known.perturbations


def test_every_departure_is_seen_where_it_should_be_and_only_there():
    plain = Synthetic(**SMALL, person_px=70.0, perturb=False)
    for name, size in DEFAULT_SIZES.items():
        dataset = Synthetic(**SMALL, person_px=70.0, **only(**{name: size}))
        shown = not np.array_equal(images(dataset), images(plain))
        camera = not np.array_equal(dataset.info.cameras[0].translation, dataset.true_camera.translation)
        start = not np.array_equal(dataset.info.initial_pose, plain.info.initial_pose)
        expected = (name in ("lengths", "radii", "profile", "clothes_m"), "camera" in name, "start" in name)
        assert (shown, camera, start) == expected, name


def test_the_subject_is_as_tall_with_other_bones_and_girths():
    body = person(from_height(1.8))
    for seed in range(20):
        subject = draw_subject(body, {**NONE, "lengths": 0.03, "radii": 0.1}, seed)
        assert height_of(subject.body.shape) == pytest.approx(height_of(body.shape), abs=1e-12)
        bones = [subject.factors[f"length_{name}"][0] for name in ("thigh", "calf", "torso", "forearm")]
        assert np.ptp(bones) > 0.001
        assert max(abs(np.log(bones))) < 0.061  # 3 %, and again as much to keep the height
        girths = subject.body.limbs.radii / body.limbs.radii
        assert np.abs(girths - 1.0).max() <= 0.1
        assert girths.std() > 0.02
        left, right = (subject.body.limbs.names.index(f"{side}_thigh") for side in ("left", "right"))
        assert np.array_equal(girths[left], girths[right])


def test_one_departure_does_not_change_with_another():
    body = person(from_height(1.7))
    alone, both = (draw_subject(body, {**NONE, "radii": 0.1, **more}, 3) for more in ({}, {"lengths": 0.03}))
    assert np.array_equal(alone.factors["radius_calf"], both.factors["radius_calf"])
    assert np.array_equal(alone.body.limbs.radii, both.body.limbs.radii)


def test_without_departures_the_subject_is_the_body_itself():
    body = person(from_height(1.7))
    assert draw_subject(body, NONE, 5).at(0.3) is body


def test_clothes_move_smoothly_and_as_far_as_asked():
    body = person(from_height(1.7))
    subject = draw_subject(body, {**NONE, "clothes_m": 0.005}, 2)
    slow, times = np.random.default_rng(0).uniform(0.0, 2000.0, 3000), np.arange(300) / 30.0  # waves beat slowly
    radii, following = (np.stack([subject.at(t).limbs.radii.mean(axis=2) for t in each]) for each in (slow, times))
    clothed = np.array(["head" not in name and "hand" not in name for name in body.limbs.names])
    assert np.array_equal(radii[:, ~clothed], np.broadcast_to(radii[0, ~clothed], radii[:, ~clothed].shape))
    assert radii[:, clothed].std(axis=0) == pytest.approx(0.005, rel=0.1)
    steps = np.abs(np.diff(following, axis=0)).max()
    assert 0.0005 < steps < 0.005  # of at most 2.5 Hz and three waves: 5 mm · 2.4 · 2π · 2.5 / 30
    slid = np.stack([subject.clothes.slid(t) for t in slow])
    assert slid[:, clothed].std(axis=0) == pytest.approx(0.005, rel=0.1)


def test_a_calibration_is_off_by_just_what_is_asked_and_otherwise_with_every_seed():
    camera = Synthetic(**SMALL, person_px=70.0, perturb=False).true_camera
    seen = camera.position + 5.0 * camera.rotation[2]
    assert miscalibrated(camera, seen, 0.0, 0.0, 1) is camera
    assert calibration_error(camera, camera) == {}
    turns = []
    for seed in range(5):
        told = miscalibrated(camera, seen, 0.01, 1.0, seed)
        off = calibration_error(camera, told)
        assert abs(off["camera_focal"][0] - 1.0) == pytest.approx(0.01)
        assert np.linalg.norm(off["camera_principal_point_px"]) == pytest.approx(1.6)
        assert np.linalg.norm(off["camera_place_m"]) == pytest.approx(0.05)
        assert np.linalg.norm(np.degrees(off["camera_turn_rad"])) == pytest.approx(1.0)
        turns.append(off["camera_turn_rad"])
    assert np.linalg.matrix_rank(turns) == 3


def test_points_lie_on_the_subject_where_the_camera_told_puts_them():
    dataset = Points(n_frames=2, n_points=300, sigma_m=0.0, outlier_fraction=0.0)
    camera, told = dataset.true_camera, dataset.calibrated_camera
    points = next(dataset.frames()).points
    seen = told.to_camera(points)
    pixels = told.project(points)
    truly = (pixels - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]] * seen[:, 2:]
    truly = (np.column_stack([truly, seen[:, 2]]) - camera.translation) @ camera.rotation
    pose, subject = dataset.sequence.motion.poses[0], dataset.sequence.subject
    depth = camera.to_camera(truly)[:, 2]
    assert np.abs(first_depth(subject.at(0.0), pose, camera, truly) - depth).max() < 2e-3
    on_told = np.abs(first_depth(dataset.sequence.body, pose, told, points) - seen[:, 2])
    assert np.median(on_told) > 0.003


def test_any_skeleton_departs_bone_by_bone_with_its_limbs_and_stands_as_tall():
    usual = person_skeleton(from_height(1.7))
    skeleton = replace(usual, names=tuple(f"joint_{k}" for k in range(len(usual.names))))
    body = Body(skeleton, from_height(1.7), skeleton_limbs(skeleton))
    subject = draw_subject(body, {**NONE, "lengths": 0.03}, 4)
    other = subject.body.skeleton
    lengths = np.linalg.norm(other.offsets[1:], axis=1) / np.linalg.norm(skeleton.offsets[1:], axis=1)
    assert lengths.std() > 0.005
    assert np.ptp(lengths) < 0.062
    neutral = np.zeros((1, len(skeleton.dof_names)))
    tall = [np.ptp(joints(each, neutral)[0, :, 2]) for each in (skeleton, other)]
    assert tall[1] == pytest.approx(tall[0], abs=1e-12)
    far = [other.names.index(name) for name in subject.body.limbs.names]
    assert subject.body.limbs.ends == pytest.approx(other.offsets[far])


def test_who_is_shown_has_feet_of_their_own_whatever_a_tracker_is_told():
    told, plain = MADE["synthetic"](neck_and_feet=True), MADE["synthetic"]()
    assert len(told.info.body.limbs) == 15
    assert plain.info.body is None
    assert told._key() == plain._key()
    assert np.array_equal(images(told), images(plain))
