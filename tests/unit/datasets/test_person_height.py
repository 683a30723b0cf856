"""A camera is recovered from upright people, with calibrated standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M

from workbench.body.camera import plain_camera
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.person_height import Measurements, calibrate_by_height, head_foot_segments, pose_by_height
from workbench.detections.joint_annotations import JointAnnotations
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
    return calibrate_by_height("one", SIZE, FRAMES, *segments, Measurements(HEIGHT_M, **measurements))


def test_exact_segments_determine_the_camera():
    calibration = calibrate(standing())
    assert calibration.values["focal_px"] == pytest.approx(1100.0, rel=0.01)
    assert calibration.values["tilt_deg"] == pytest.approx(5.0, abs=0.2)
    assert calibration.values["roll_deg"] == pytest.approx(0.0, abs=0.1)
    assert calibration.values["height_m"] == pytest.approx(1.5, rel=0.02)
    assert calibration.error_px < 0.5
    assert calibration.focal_information > 0.9
    assert calibration.camera.position[2] == pytest.approx(calibration.values["height_m"])


def test_the_pose_of_a_camera_with_known_intrinsics_is_recovered():
    """The lens has distortion, pixels that are not square and an off-centre principal point."""
    camera = plain_camera(*SIZE, 1100.0, (0.0, 0.0, 1.5), (1.5 / np.tan(np.radians(5.0)), 0.0, 0.0))
    ideal = standing(near_m=6.0, far_m=6.0)  # a constant distance does not determine the focal length
    matrix = np.array([[1100.0, 0.0, 700.0], [0.0, 1050.0, 300.0], [0.0, 0.0, 1.0]])
    lens = replace(camera, matrix=matrix, rotation=np.eye(3), translation=np.zeros(3),
                   distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0]))  # fmt: skip
    rays = [np.concatenate([camera.undistorted(pixels), np.ones((12, 1))], axis=1) for pixels in ideal]
    feet, heads = (lens.project(points) for points in rays)
    calibration = pose_by_height(lens, FRAMES, feet, heads, Measurements(HEIGHT_M))
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
    return JointAnnotations("annotations.csv", np.arange(frames), pixels, np.isfinite(pixels[..., 0]))


def test_a_segment_connects_the_midpoint_of_the_ankles_and_the_head():
    frames, feet, heads = head_foot_segments(
        annotations(3, {"left_ankle": (10, 90), "right_ankle": (20, 92), "head_centre": (14, 5)})
    )
    assert frames == (0, 1, 2)
    np.testing.assert_array_equal(feet[0], [15, 91])
    np.testing.assert_array_equal(heads[0], [14, 5])


def test_invalid_input_is_an_error():
    with pytest.raises(InputError, match="found 0"):
        head_foot_segments(annotations(5, {"left_ankle": (10, 90)}))
    with pytest.raises(InputError, match=r"0.5 to 2.5 m"):
        Measurements(165.0)
    with pytest.raises(InputError, match="positive distance"):
        Measurements(1.7, distance_m=-1.0)
    with pytest.raises(InputError, match="head above the ankles"):
        calibrate(standing()[::-1])


def test_gait_increases_the_uncertainty_and_the_weight_of_the_prior():
    """Errors due to gait are correlated within a step, so that more frames per step add no information."""
    segments = standing(near_m=6.0, far_m=6.5, sigma_px=8.0)
    no_gait, gait, slow = (
        calibrate(segments, gait=gait, step_frames=step) for gait, step in ((0.0, 1.0), (0.05, 1.0), (0.05, 6.0))
    )
    assert no_gait.sigma["tilt_deg"] < gait.sigma["tilt_deg"] < slow.sigma["tilt_deg"]
    assert abs(slow.values["focal_px"] - SIZE[0]) <= abs(no_gait.values["focal_px"] - SIZE[0])
