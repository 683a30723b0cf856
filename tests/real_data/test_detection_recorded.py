"""People detected in a recorded video by BlazePose's full model, against joints annotated by hand."""

import cv2
import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import load_cameras
from workbench.detections.detector import landmark_network
from workbench.detections.detector.detection_files import detect_video
from workbench.detections.detector.landmark_network import LandmarkNetwork, Region
from workbench.detections.detector.people_detector import PeopleDetector
from workbench.detections.joint_annotations import read_annotations
from workbench.motion.formats.markers import joint_centres, read_markers
from workbench.utils.decode import decode
from workbench.utils.errors import InputError
from workbench.utils.frame_times import given_times

LANDMARKS = {"shoulder": 11, "elbow": 13, "wrist": 15, "hip": 23, "knee": 25, "ankle": 27}
FRAMES = range(98, 102)
RATE_HZ = 60.0


@pytest.fixture(scope="module")
def people(data):
    network = LandmarkNetwork(data / "blazepose" / "pose_landmark_full.tflite")
    images = decode(data / "sports2d_walk" / "demo.mp4", FRAMES[0], FRAMES[-1])
    return list(PeopleDetector(network, 3).detect(images))


def test_two_people_are_detected_in_every_frame(people):
    assert all({person.number for person in frame} == {0, 1} for frame in people)


def test_the_joints_agree_with_the_annotations(data, people):
    annotations = read_annotations(data / "sports2d_walk" / "keypoints.csv")
    joints, _ = annotations.at(100)
    errors = []
    for person in people[FRAMES.index(100)]:
        pixels = {
            f"{side}_{joint}": person.landmarks.pixels[first + k]
            for joint, first in LANDMARKS.items()
            for k, side in enumerate(("left", "right"))
        }
        errors.append(np.mean([np.linalg.norm(pixels[name] - joints[JOINT_NAMES.index(name)]) for name in pixels]))
    assert min(errors) < 15.0  # of 390 px height; annotations have a deviation of 4 px, of hidden joints 6 to 10 px


def test_world_landmarks_rotate_with_the_region(data):
    network = LandmarkNetwork(data / "blazepose" / "pose_landmark_full.tflite")
    (image,) = decode(data / "sports2d_walk" / "demo.mp4", 100, 100)
    region = Region(960.0, 690.0, 560.0)
    for _ in range(3):
        region = network(image, region).next_region
    upright = network(image, region)
    rotated = network(np.ascontiguousarray(np.rot90(image)), _rotated(region, image.shape[1]))
    np.testing.assert_allclose(rotated.world[:, 0], upright.world[:, 1], atol=0.03)
    np.testing.assert_allclose(rotated.world[:, 1], -upright.world[:, 0], atol=0.03)


def _rotated(region, width):
    """Return the region in the image rotated by 90° counterclockwise."""
    return Region(region.v, width - 1 - region.u, region.side, region.angle - 0.5 * np.pi)


def test_a_file_that_is_no_model_is_refused(tmp_path):
    (tmp_path / "model.tflite").write_bytes(b"no model")
    with pytest.raises(InputError, match="expected a BlazePose landmark model"):
        LandmarkNetwork(tmp_path / "model.tflite")


def test_litert_agrees_with_opencv(data, monkeypatch):
    pytest.importorskip("ai_edge_litert")
    path = data / "blazepose" / "pose_landmark_full.tflite"
    (image,) = decode(data / "sports2d_walk" / "demo.mp4", 100, 100)
    litert = LandmarkNetwork(path)(image, Region(960.0, 690.0, 560.0))
    monkeypatch.setattr(landmark_network, "find_spec", lambda _: None)
    opencv = LandmarkNetwork(path)(image, Region(960.0, 690.0, 560.0))
    assert not np.array_equal(litert.pixels, opencv.pixels)
    np.testing.assert_allclose(litert.pixels, opencv.pixels, atol=0.01)
    np.testing.assert_allclose(litert.world, opencv.world, atol=1e-4)
    np.testing.assert_allclose(litert.confidence, opencv.confidence, atol=1e-4)


@pytest.mark.slow
def test_left_and_right_in_one_camera_agree_with_four_cameras(data, tmp_path):
    """The network exchanges left and right in 16 of the frames 20 to 59."""
    scene, images = data / "pose2sim_balance", tmp_path / "images"
    images.mkdir()
    for frame, image in enumerate(decode(scene / "cam02.mp4", 20, 59), 20):
        cv2.imwrite(str(images / f"{frame}.jpg"), image[..., ::-1])
    detect_video(images, tmp_path / "cam02", data / "blazepose" / "pose_landmark_full.tflite")
    detected = read_annotations(tmp_path / "cam02", None, given_times(RATE_HZ))
    camera = next(one for one in load_cameras(scene / "Calib_qualisys.toml") if one.name == "cam_02")
    markers = read_markers(scene / "joints_triangulated.trc")
    true = camera.project(joint_centres(markers, markers.at((20 + detected.frames) / RATE_HZ), {}))
    for part in (("elbow", "wrist"), ("knee", "ankle")):
        left, right = ([JOINT_NAMES.index(f"{side}_{limb}") for limb in part] for side in ("left", "right"))
        correct, exchanged = (
            np.linalg.norm(detected.pixels[:, left + right] - true[:, order], axis=2).sum(axis=1)
            for order in (left + right, right + left)
        )
        separate = np.linalg.norm(true[:, left] - true[:, right], axis=2).max(axis=1) > 25.0
        assert separate.sum() > 20
        assert not (separate & (exchanged < correct)).any()
