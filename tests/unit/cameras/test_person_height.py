"""A camera is recovered from upright people, with calibrated standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT, from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras import person_height
from workbench.cameras.camera import plain_camera
from workbench.cameras.person_height import (
    Measurements,
    Segments,
    _Problem,
    calibrate_by_height,
    detected_segments,
    head_foot_segments,
    in_image,
    pose_by_height,
    upright,
)
from workbench.utils.errors import InputError

SIZE = (1280, 720)
FRAMES = tuple(range(12))


def standing(focal_px=1100.0, height_m=1.5, near_m=4.0, far_m=9.0, sigma_px=0.0, seed=0):
    """Return ankles and heads (12, 2), px, of a person standing at 12 positions; the camera is tilted down by 5°."""
    target_distance = height_m / np.tan(np.radians(5.0))
    camera = plain_camera(*SIZE, focal_px, (0.0, 0.0, height_m), (target_distance, 0.0, 0.0))
    rng = np.random.default_rng(seed)
    ankles = np.column_stack(
        [np.linspace(near_m, far_m, 12), rng.uniform(-1.5, 1.5, 12), np.full(12, ANKLE_HEIGHT * HEIGHT_M)]
    )
    heads = ankles + np.array([0.0, 0.0, (HEAD_HEIGHT - ANKLE_HEIGHT) * HEIGHT_M])
    return tuple(camera.project(points) + rng.normal(0.0, sigma_px, (12, 2)) for points in (ankles, heads))


def calibrate(segments, **measurements):
    return calibrate_by_height("one", SIZE, Segments(FRAMES, *segments), Measurements(HEIGHT_M, **measurements))


def test_exact_segments_determine_the_camera():
    """As far as an unknown lean of the person allows."""
    calibration = calibrate(standing())
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.05)
    assert calibration.values["tilt_deg"] == pytest.approx(5.0, abs=0.5)
    assert calibration.values["roll_deg"] == pytest.approx(0.0, abs=0.1)
    assert calibration.values["height_m"] == pytest.approx(1.5, rel=0.02)
    assert calibration.error_px < 0.5
    assert calibration.focal_information > 0.75
    assert calibration.camera.position[2] == pytest.approx(calibration.values["height_m"])
    np.testing.assert_allclose(calibration.camera.matrix[:2, 2], (np.array(SIZE) - 1.0) / 2.0)


@pytest.mark.parametrize(("tilt_deg", "rel"), [(0.0, 1e-9), (-10.0, 0.15), (10.0, 0.15)])
def test_the_search_begins_near_the_camera_of_a_known_tilt(tilt_deg, rel):
    """Lengths of segments determine the distances and the height, exactly of a level camera."""
    camera = plain_camera(*SIZE, 1100.0, (0.0, 0.0, 1.5), (1.0, 0.0, 1.5 - np.tan(np.radians(tilt_deg))))
    ankles = np.array([[6.0, -1.5, ANKLE_HEIGHT * HEIGHT_M], [8.0, 0.5, ANKLE_HEIGHT * HEIGHT_M]])
    heads = ankles + np.array([0.0, 0.0, (HEAD_HEIGHT - ANKLE_HEIGHT) * HEIGHT_M])
    segments = Segments((0, 1), camera.project(ankles), camera.project(heads))
    x = _Problem(SIZE, segments, Measurements(HEIGHT_M, focal_px=1100.0)).initial(np.radians(tilt_deg))
    assert x[[0, 1, 2, 4, 5, 6]] == pytest.approx([np.log(1100.0), np.radians(tilt_deg), 0.0, 0.0, 0.0, 0.0])
    assert np.exp(x[3]) == pytest.approx(1.5, rel=rel)
    assert np.exp(x[7::2]) == pytest.approx(ankles[:, 0], rel=rel)
    assert x[8::2] == pytest.approx(ankles[:, 1] / ankles[:, 0], rel=rel)


def test_the_pose_of_a_camera_with_known_intrinsics_is_recovered():
    """The lens has distortion, pixels that are not square and an off-centre principal point."""
    camera = plain_camera(*SIZE, 1100.0, (0.0, 0.0, 1.5), (1.5 / np.tan(np.radians(5.0)), 0.0, 0.0))
    ideal = standing(near_m=6.0, far_m=6.0)  # a constant distance does not determine the focal length
    matrix = np.array([[1100.0, 0.0, 700.0], [0.0, 1050.0, 300.0], [0.0, 0.0, 1.0]])
    lens = replace(camera, matrix=matrix, rotation=np.eye(3), translation=np.zeros(3),
                   distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0]))  # fmt: skip
    rays = [np.concatenate([camera.undistorted(pixels), np.ones((12, 1))], axis=1) for pixels in ideal]
    feet, heads = (lens.project(points) for points in rays)
    calibration = pose_by_height(lens, Segments(FRAMES, feet, heads), Measurements(HEIGHT_M))
    np.testing.assert_array_equal(calibration.camera.matrix, matrix)
    np.testing.assert_array_equal(calibration.camera.distortion, lens.distortion)
    np.testing.assert_allclose(calibration.camera.rotation, camera.rotation, atol=0.01)
    np.testing.assert_allclose(calibration.camera.position, camera.position, atol=0.03)
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=1e-5)


def test_errors_agree_with_the_standard_deviations():
    """Squared errors over variances have mean 1 over 4 parameters and 12 draws; the priors reduce it."""
    squared = []
    for seed in range(12):
        calibration = calibrate(standing(sigma_px=3.0, seed=seed))
        true = {"focal_px": 1100.0, "tilt_deg": 5.0, "roll_deg": 0.0, "height_m": 1.5}
        squared += [((calibration.values[key] - value) / calibration.sigma[key]) ** 2 for key, value in true.items()]
    assert 0.3 < np.mean(squared) < 1.7


def test_a_constant_distance_does_not_determine_the_focal_length():
    calibration = calibrate(standing(near_m=6.0, far_m=6.0, sigma_px=2.0))
    assert calibration.focal_information < 0.5
    assert calibration.sigma["focal_px"] > 200.0


def test_a_measured_distance_determines_the_focal_length():
    calibration = calibrate(standing(near_m=6.0, far_m=6.0, sigma_px=2.0), distance_m=6.1)
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.1)
    assert calibration.sigma["focal_px"] < 120.0


def test_a_known_focal_length_is_used():
    calibration = calibrate(standing(near_m=6.0, far_m=6.0), focal_px=1100.0)
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.02)


def annotations(frames, joints):
    pixels = np.full((frames, len(JOINT_NAMES), 2), np.nan)
    for name, pixel in joints.items():
        pixels[:, JOINT_NAMES.index(name)] = pixel
    return np.arange(frames), pixels, "annotations.csv"


def test_a_segment_connects_the_midpoint_of_the_ankles_and_the_head():
    frames, feet, heads, *_ = head_foot_segments(
        *annotations(3, {"left_ankle": (10, 90), "right_ankle": (20, 92), "head_centre": (14, 5)})
    )
    assert frames == (0, 1, 2)
    np.testing.assert_array_equal(feet[0], [15, 91])
    np.testing.assert_array_equal(heads[0], [14, 5])


def test_invalid_input_is_an_error():
    with pytest.raises(InputError, match="found 0"):
        head_foot_segments(*annotations(5, {"left_ankle": (10, 90)}))
    with pytest.raises(InputError, match=r"0.5 to 2.5 m"):
        Measurements(165.0)
    with pytest.raises(InputError, match="positive distance"):
        Measurements(1.7, distance_m=-1.0)
    with pytest.raises(InputError, match="head above the ankles"):
        head_foot_segments(*annotations(3, {"left_ankle": (9, 5), "right_ankle": (9, 5), "head_centre": (9, 90)}))


def test_gait_increases_the_uncertainty_and_the_weight_of_the_prior():
    """Errors due to gait are correlated within a step, so that more frames per step add no information."""
    segments = standing(near_m=6.0, far_m=6.5, sigma_px=8.0)
    no_gait, gait, slow = (
        calibrate(segments, gait=gait, step_frames=step) for gait, step in ((0.0, 1.0), (0.05, 1.0), (0.05, 6.0))
    )
    assert no_gait.sigma["tilt_deg"] < gait.sigma["tilt_deg"] < slow.sigma["tilt_deg"]
    assert abs(slow.values["focal_px"] - SIZE[0]) <= abs(no_gait.values["focal_px"] - SIZE[0])


SKELETON = person(from_height(HEIGHT_M)).skeleton
POSTURES = {
    "upright": (0.0, 0.0),
    "bent knees": (0.9, 0.4),
    "squat": (2.0, 1.5),
    "sitting": (1.5, 1.5),
    "bow": (0.0, 1.4),
}
"""Flexions of knees and hips, rad."""
UPRIGHT_POSTURES = ("upright", "bent knees")


def posture(name):
    """Return joints (J, 3), m, with the lower ankle at its height above the floor z = 0."""
    pose = np.zeros(len(SKELETON.dof_names))
    for joint, angle in zip(("knee", "hip"), POSTURES[name], strict=True):
        for side in ("left", "right"):
            pose[SKELETON.dof_names.index(f"{side}_{joint}_flexion")] = angle
    places = joints(SKELETON, pose[None])[0]
    return places - [0.0, 0.0, places[:, 2].min() - ANKLE_HEIGHT * HEIGHT_M]


def detected(rng, names, near_m=4.0, far_m=9.0, confidence=0.95, tilt_deg=None):
    """Return a random camera and detections of one person in postures at random places."""
    height_m, tilt = rng.uniform(0.8, 2.5), np.radians(rng.uniform(0.0, 12.0))
    if tilt_deg is not None:
        tilt = np.radians(tilt_deg)
    camera = plain_camera(*SIZE, rng.uniform(800.0, 1400.0), (0.0, 0.0, height_m), (1.0, 0.0, height_m - np.tan(tilt)))
    places = np.array([posture(name) for name in names])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    across = rng.uniform(-0.2, 0.2, len(names))
    ahead = rng.uniform(near_m, far_m, len(names))
    world = places @ turn.T + np.stack([ahead, across * ahead, np.zeros(len(names))], axis=1)[:, None]
    pixels = camera.project(world) + rng.normal(0.0, 2.0, (*world.shape[:2], 2))
    order = [SKELETON.joint(name) for name in JOINT_NAMES]
    rays = camera.directions(camera.undistorted(pixels.mean(axis=1)))
    axes = np.stack([camera.viewing_axes(ray) for ray in rays])
    landmarks = 0.9 * (world @ axes.swapaxes(1, 2))[:, order]
    certain = np.full(pixels.shape[:2], confidence)
    return camera, (np.arange(len(names)), in_image(pixels[:, order], SIZE), certain[:, order], landmarks)


@pytest.mark.parametrize("name", POSTURES)
def test_an_upright_person_is_known_by_the_landmarks(name):
    _, detections = detected(np.random.default_rng(1), [name] * 3)
    assert upright(detections[3]).all() == (name in UPRIGHT_POSTURES)
    assert not upright(np.full((1, len(JOINT_NAMES), 3), np.nan)).any()


def test_only_detections_of_an_upright_person_from_head_to_feet_are_evidence():
    names = ["upright", "squat"] * 8
    _, (frames, pixels, confidence, landmarks) = detected(np.random.default_rng(2), names, 5.0)
    shown, hidden, below = pixels.copy(), confidence.copy(), pixels.copy()
    hidden[2, JOINT_NAMES.index("left_ankle")] = 0.3
    below[4, JOINT_NAMES.index("right_ankle"), 1] = SIZE[1] + 5.0
    upright_frames = tuple(range(0, 16, 2))
    assert detected_segments(frames, shown, confidence, landmarks)[0] == upright_frames
    assert detected_segments(frames, shown, confidence, None)[0] == tuple(range(16))
    assert detected_segments(frames, shown, hidden, landmarks)[0] == tuple(f for f in upright_frames if f != 2)
    assert detected_segments(frames, in_image(below, SIZE), confidence, landmarks)[0] == tuple(
        f for f in upright_frames if f != 4
    )


@pytest.mark.parametrize(("n_upright", "n_segments"), [(2, 10), (3, 3)])
def test_posture_and_inclination_are_unknown_with_fewer_than_three_upright_frames(n_upright, n_segments):
    names = ["upright"] * n_upright + ["sitting"] * (10 - n_upright)
    _, detections = detected(np.random.default_rng(8), names, near_m=6.0)
    segments = detected_segments(*detections)
    assert len(segments.frames) == n_segments
    assert segments.posture_spread == pytest.approx(0.02 if n_upright == 3 else 0.15)
    assert np.isfinite(segments.inclination) == (n_upright == 3)


@pytest.mark.parametrize("tilt_deg", [-3.0, 5.0, 15.0])
def test_upright_landmarks_measure_the_inclination(tilt_deg):
    """The ray to the middle of the person is below the optical axis by an angle that adds to the tilt."""
    camera, detections = detected(np.random.default_rng(9), ["upright"] * 5, 9.0, 10.0, tilt_deg=tilt_deg)
    segments = detected_segments(*detections)
    below = np.degrees(np.arctan((segments.middle[1] - camera.matrix[1, 2]) / camera.matrix[1, 1]))
    assert np.degrees(segments.inclination) == pytest.approx(tilt_deg + below, abs=2.0)


def test_landmarks_measure_a_tilt_that_segments_of_one_distance_do_not():
    feet, heads = standing(near_m=6.0, far_m=6.0, sigma_px=3.0)
    segments = Segments(FRAMES, feet, heads)
    measured = segments._replace(inclination=np.radians(25.0), middle=(640.0, 360.0))
    without, with_landmarks = (
        calibrate_by_height("one", SIZE, each, Measurements(HEIGHT_M)) for each in (segments, measured)
    )
    assert without.values["tilt_deg"] < with_landmarks.values["tilt_deg"] < 25.0


def test_squats_do_not_change_the_camera():
    """The squatting person's segments are a third shorter, as if the person were farther away."""
    rng = np.random.default_rng(3)
    _, detections = detected(rng, ["upright"] * 10 + ["squat"] * 20, near_m=5.0)
    with_squats = calibrate_by_height("one", SIZE, detected_segments(*detections), Measurements(HEIGHT_M))
    upright_only = tuple(array[:10] for array in detections[:4])
    without = calibrate_by_height("one", SIZE, detected_segments(*upright_only), Measurements(HEIGHT_M))
    assert with_squats.values == without.values


@pytest.mark.slow
def test_the_stated_standard_deviations_cover_random_cameras():
    z = []
    for seed in range(40):
        camera, detections = detected(np.random.default_rng(seed), ["upright"] * 12, near_m=4.5)
        estimate = calibrate_by_height("one", SIZE, detected_segments(*detections), Measurements(HEIGHT_M))
        z.append((estimate.values["focal_px"] - camera.matrix[0, 0]) / estimate.sigma["focal_px"])
    assert np.mean(np.abs(z) < 1.645) >= 0.8


def test_of_one_place_the_longest_segment_is_evidence():
    """A slight bend that passes for upright is not taken for distance; a step aside is another place."""
    _, (frames, pixels, confidence, landmarks) = detected(np.random.default_rng(5), ["upright"] * 4, near_m=6.0)
    head = JOINT_NAMES.index("head_centre")
    pixels[:] = pixels[0]
    pixels[1, head, 1] += 20.0
    height_px = np.linalg.norm(pixels[0, head] - pixels[0, JOINT_NAMES.index("left_ankle")])
    pixels[2, :, 0] += 0.02 * height_px
    pixels[3, :, 0] += 0.05 * height_px
    assert detected_segments(frames, pixels, confidence, landmarks)[0] == (0, 3)


@pytest.mark.parametrize("name", ["squat", "sitting"])
def test_an_unknown_posture_makes_the_camera_uncertain(name):
    camera, detections = detected(np.random.default_rng(4), [name] * 10)
    estimate = calibrate_by_height("one", SIZE, detected_segments(*detections), Measurements(HEIGHT_M))
    known = calibrate_by_height("one", SIZE, detected_segments(*detections[:3], None), Measurements(HEIGHT_M))
    assert estimate.frames == known.frames
    for each in estimate.sigma:
        assert estimate.sigma[each] > known.sigma[each]
    assert abs(estimate.values["focal_px"] - camera.matrix[0, 0]) < 3.0 * estimate.sigma["focal_px"]


def test_without_a_person_from_head_to_feet_the_camera_is_level_and_uncertain():
    _, (frames, pixels, confidence, landmarks) = detected(np.random.default_rng(4), ["upright"] * 10)
    segments = detected_segments(frames, pixels, np.zeros_like(confidence), landmarks)
    estimate = calibrate_by_height("one", SIZE, segments, Measurements(HEIGHT_M))
    assert estimate.frames == ()
    assert estimate.values["tilt_deg"] == estimate.values["roll_deg"] == 0.0
    assert estimate.sigma["tilt_deg"] == pytest.approx(15.0)
    assert estimate.sigma["focal_px"] > 0.3 * estimate.values["focal_px"]
    assert estimate.error_px == 0.0


def test_a_high_camera_is_found():
    camera = plain_camera(*SIZE, 1000.0, (0.0, 0.0, 6.0), (10.0, 0.0, 0.0))
    feet = np.column_stack([np.linspace(7.0, 16.0, 12), np.linspace(-2.0, 2.0, 12), np.full(12, 0.039 * HEIGHT_M)])
    heads = feet + np.array([0.0, 0.0, (HEAD_HEIGHT - ANKLE_HEIGHT) * HEIGHT_M])
    estimate = calibrate((camera.project(feet), camera.project(heads)))
    assert estimate.values["tilt_deg"] == pytest.approx(np.degrees(np.arctan2(6.0, 10.0)), abs=2.0)
    assert estimate.values["height_m"] == pytest.approx(6.0, rel=0.1)


def test_outliers_are_no_evidence():
    feet, heads = standing(sigma_px=2.0)
    heads_wrong, feet_wrong = heads.copy(), feet.copy()
    heads_wrong[3], feet_wrong[7] = feet[3] + [5.0, 40.0], feet[7] + [200.0, -150.0]
    right, robust = calibrate((feet, heads)), calibrate((feet_wrong, heads_wrong))
    for name, value in right.values.items():
        assert abs(robust.values[name] - value) < 3.0 * right.sigma[name]


@pytest.mark.parametrize("height_m", [0.5, 2.5])
@pytest.mark.parametrize("n", [1, 2, 12])
def test_every_height_and_any_number_of_small_or_large_segments_has_a_finite_camera(height_m, n):
    rng = np.random.default_rng(n)
    for lengths in (3.0, 60.0, 700.0):
        feet = rng.uniform(0.0, 719.0, (n, 2))
        heads = feet - [0.0, 1.0] * rng.uniform(0.5 * lengths, lengths, (n, 1))
        estimate = calibrate_by_height(
            "one", SIZE, Segments(tuple(range(n)), feet, heads), Measurements(height_m, gait=0.04)
        )
        assert np.isfinite([*estimate.values.values(), *estimate.sigma.values()]).all()


def test_the_jacobian_is_that_of_the_residuals():
    problem = person_height._Problem(
        SIZE, Segments(FRAMES, *standing(sigma_px=8.0)), Measurements(HEIGHT_M, distance_m=4.0)
    )
    x = problem.initial(0.1) + 0.01
    steps = 1e-6 * np.eye(len(x))
    numerical = (
        np.stack([problem.residuals(x + step, 2.0) - problem.residuals(x - step, 2.0) for step in steps]).T / 2e-6
    )
    np.testing.assert_allclose(problem.jacobian(x, 2.0), numerical, rtol=1e-4, atol=1e-3)


def test_the_uncertainty_of_the_camera_is_that_of_its_values():
    """The row's focal length is number 12; number 10 is the camera's height, for a level camera."""
    estimate = calibrate(standing(sigma_px=2.0))
    spread = np.sqrt((estimate.camera.uncertainty**2).sum(axis=0))
    assert spread[12] == pytest.approx(estimate.sigma["focal_px"], rel=1e-3)
    half = estimate.camera.scaled(0.5)
    assert np.sqrt((half.uncertainty**2).sum(axis=0))[12] == pytest.approx(0.5 * spread[12])
    np.testing.assert_array_equal(half.uncertainty[:, :12], estimate.camera.uncertainty[:, :12])
    known = pose_by_height(estimate.camera, Segments(FRAMES, *standing(sigma_px=2.0)), Measurements(HEIGHT_M))
    assert not known.camera.uncertainty[:, 12:].any()
    assert known.camera.uncertainty[:, :12].any()


def test_the_uncertainty_of_a_camera_turns_with_it():
    """As the difference of two cameras turned alike."""
    camera = calibrate(standing(sigma_px=2.0)).camera
    turn, zoom = turn_about_y(0.3), 1.2
    change = 1e-6 * camera.uncertainty[1]
    other = replace(
        camera, rotation=camera.rotation + change[:9].reshape(3, 3), translation=camera.translation + change[9:12],
        matrix=camera.matrix + np.diag([*change[12:14], 0.0]),
    )  # fmt: skip
    difference = (other.turned(turn, zoom).row - camera.turned(turn, zoom).row) / 1e-6
    np.testing.assert_allclose(camera.turned(turn, zoom).uncertainty[1], difference, rtol=1e-5, atol=1e-6)


def turn_about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
