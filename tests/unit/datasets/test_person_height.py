"""A camera is recovered from upright people, with calibrated standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M

from workbench.body.camera import plain_camera
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.files.joint_annotations import JointAnnotations
from workbench.datasets.person_height import Measurements, calibrate_by_height, head_foot_segments, pose_by_height
from workbench.utils.errors import InputError

SIZE = (1280, 720)
FRAMES = tuple(range(12))


def standing(focal_px=1100.0, height_m=1.5, near_m=4.0, far_m=9.0, sigma_px=0.0, seed=0):
    """Feet and heads, px, of somebody who stands at 12 places before a camera that looks 5° down."""
    ahead = height_m / np.tan(np.radians(5.0))
    camera = plain_camera(*SIZE, focal_px, (0.0, 0.0, height_m), (ahead, 0.0, 0.0))
    rng = np.random.default_rng(seed)
    at = np.column_stack(
        [np.linspace(near_m, far_m, 12), rng.uniform(-1.5, 1.5, 12), np.full(12, ANKLE_HEIGHT * HEIGHT_M)]
    )
    top = at + np.array([0.0, 0.0, (HEAD_HEIGHT - ANKLE_HEIGHT) * HEIGHT_M])
    return tuple(camera.project(points) + rng.normal(0.0, sigma_px, (12, 2)) for points in (at, top))


def test_exact_segments_outweigh_the_prior():
    calibration = calibrate_by_height("one", SIZE, FRAMES, *standing(), Measurements(HEIGHT_M))
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.01)
    assert calibration.values["tilt_deg"] == pytest.approx(5.0, abs=0.2)
    assert calibration.values["roll_deg"] == pytest.approx(0.0, abs=0.1)
    assert calibration.values["height_m"] == pytest.approx(1.5, rel=0.02)
    assert calibration.error_px < 0.5
    assert calibration.focal_information > 0.9
    assert calibration.camera.position[2] == pytest.approx(calibration.values["height_m"])


def test_a_known_lens_gives_the_pose_and_stays_as_it_is():
    """Of a lens with distortion, pixels that are not square and a principal point far from the middle."""
    plain = plain_camera(*SIZE, 1100.0, (0.0, 0.0, 1.5), (1.5 / np.tan(np.radians(5.0)), 0.0, 0.0))
    ideal = standing(near_m=6.0, far_m=6.0)  # at a constant distance, which does not determine the focal length
    matrix = np.array([[1100.0, 0.0, 700.0], [0.0, 1050.0, 300.0], [0.0, 0.0, 1.0]])
    lens = replace(plain, matrix=matrix, rotation=np.eye(3), translation=np.zeros(3),
                   distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0]))  # fmt: skip
    rays = [np.concatenate([plain.undistorted(pixels), np.ones((12, 1))], axis=1) for pixels in ideal]
    feet, heads = (lens.project(each) for each in rays)
    calibration = pose_by_height(lens, FRAMES, feet, heads, Measurements(HEIGHT_M))
    np.testing.assert_array_equal(calibration.camera.matrix, matrix)
    np.testing.assert_array_equal(calibration.camera.distortion, lens.distortion)
    np.testing.assert_allclose(calibration.camera.rotation, plain.rotation, atol=0.01)
    np.testing.assert_allclose(calibration.camera.position, plain.position, atol=0.03)
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=1e-5)


def test_errors_from_noisy_annotations_agree_with_their_standard_deviations():
    """Of 4 numbers over 12 draws, squared errors over variances are 1 in the mean; priors and postures make it less."""
    squared = []
    for seed in range(12):
        calibration = calibrate_by_height(
            "one", SIZE, FRAMES, *standing(sigma_px=3.0, seed=seed), Measurements(HEIGHT_M)
        )
        true = {"focal_px": 1100.0, "tilt_deg": 5.0, "roll_deg": 0.0, "height_m": 1.5}
        squared += [((calibration.values[key] - value) / calibration.sigma[key]) ** 2 for key, value in true.items()]
    assert 0.3 < np.mean(squared) < 1.7


def test_a_constant_distance_does_not_determine_the_focal_length():
    calibration = calibrate_by_height(
        "one", SIZE, FRAMES, *standing(near_m=6.0, far_m=6.0, sigma_px=2.0), Measurements(HEIGHT_M)
    )
    assert calibration.focal_information < 0.5
    assert calibration.sigma["focal_px"] > 200.0


def test_a_measured_distance_determines_it():
    feet, heads = standing(near_m=6.0, far_m=6.0, sigma_px=2.0)
    calibration = calibrate_by_height("one", SIZE, FRAMES, feet, heads, Measurements(HEIGHT_M, distance_m=6.1))
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.1)
    assert calibration.sigma["focal_px"] < 120.0


def test_a_given_focal_length_is_used():
    calibration = calibrate_by_height(
        "one", SIZE, FRAMES, *standing(near_m=6.0, far_m=6.0), Measurements(HEIGHT_M, focal_px=1100.0)
    )
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.02)


def marks(frames, joints):
    pixels = np.full((frames, len(JOINT_NAMES), 2), np.nan)
    for name, place in joints.items():
        pixels[:, JOINT_NAMES.index(name)] = place
    return JointAnnotations("marks.csv", np.arange(frames), pixels, np.isfinite(pixels[..., 0]))


def test_a_segment_runs_from_between_the_ankles_to_the_head():
    frames, feet, heads = head_foot_segments(
        marks(3, {"left_ankle": (10, 90), "right_ankle": (20, 92), "head_centre": (14, 5)})
    )
    assert frames == (0, 1, 2)
    np.testing.assert_array_equal(feet[0], [15, 91])
    np.testing.assert_array_equal(heads[0], [14, 5])


def test_bad_input_is_one_sentence():
    with pytest.raises(InputError, match="found 0"):
        head_foot_segments(marks(5, {"left_ankle": (10, 90)}))
    with pytest.raises(InputError, match=r"0.5 to 2.5 m"):
        Measurements(165.0)
    with pytest.raises(InputError, match="positive distance"):
        Measurements(1.7, distance_m=-1.0)
    feet, heads = standing()
    with pytest.raises(InputError, match="head above the ankles"):
        calibrate_by_height("one", SIZE, FRAMES, heads, feet, Measurements(HEIGHT_M))


def test_a_gait_makes_the_estimate_less_certain_and_closer_to_the_usual_camera():
    """Its errors are the same within a step, so that more frames of the same steps add nothing."""
    feet, heads = standing(near_m=6.0, far_m=6.5, sigma_px=8.0)
    plain, gait, slow = (
        calibrate_by_height("one", SIZE, FRAMES, feet, heads, Measurements(HEIGHT_M, gait=gait, step_frames=step))
        for gait, step in ((0.0, 1.0), (0.05, 1.0), (0.05, 6.0))
    )
    assert plain.sigma["tilt_deg"] < gait.sigma["tilt_deg"] < slow.sigma["tilt_deg"]
    assert abs(slow.values["focal_px"] - SIZE[0]) <= abs(plain.values["focal_px"] - SIZE[0])
