"""People detected in a recorded video by BlazePose's full model, against joints annotated by hand."""

import numpy as np
import pytest

from workbench.body.camera import load_cameras
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.detection import landmark_network
from workbench.datasets.detection.detection_files import detect_video
from workbench.datasets.detection.landmark_network import LandmarkNetwork, Region
from workbench.datasets.detection.people_detector import PeopleDetector
from workbench.datasets.files.decode import decode
from workbench.datasets.files.frame_times import given_times
from workbench.datasets.files.joint_annotations import read_annotations
from workbench.motion.formats.markers import joint_centres, read_markers
from workbench.utils.errors import InputError

LANDMARKS = {"shoulder": 11, "elbow": 13, "wrist": 15, "hip": 23, "knee": 25, "ankle": 27}
FRAMES = range(98, 104)
RATE_HZ = 60.0


@pytest.fixture(scope="module")
def people(data):
    network = LandmarkNetwork(data / "blazepose" / "pose_landmark_full.tflite")
    images = decode(data / "sports2d_walk" / "demo.mp4", FRAMES[0], FRAMES[-1])
    return list(PeopleDetector(network, 3).detect(images))


def test_the_woman_and_the_bystander_are_detected_in_every_frame(people):
    assert all({person.number for person in frame} == {0, 1} for frame in people)


def test_her_joints_lie_where_they_were_annotated(data, people):
    annotations = read_annotations(data / "sports2d_walk" / "keypoints.csv")
    joints, _ = annotations.at(100)
    errors = []
    for person in people[FRAMES.index(100)]:
        places = {
            f"{side}_{joint}": person.landmarks.pixels[first + k]
            for joint, first in LANDMARKS.items()
            for k, side in enumerate(("left", "right"))
        }
        errors.append(np.mean([np.linalg.norm(places[name] - joints[j]) for name, j in _rows(places)]))
    assert min(errors) < 15.0  # of 390 px; annotations have a deviation of 4 px, hidden joints of 6 to 10


def _rows(names):
    return [(name, JOINT_NAMES.index(name)) for name in names]


def test_world_landmarks_turn_with_the_region(data):
    network = LandmarkNetwork(data / "blazepose" / "pose_landmark_full.tflite")
    (image,) = decode(data / "sports2d_walk" / "demo.mp4", 100, 100)
    region = Region(960.0, 690.0, 560.0)
    for _ in range(3):
        region = network(image, region).next_region
    upright = network(image, region)
    quarter = network(np.ascontiguousarray(np.rot90(image)), _turned(region, image.shape[1]))
    np.testing.assert_allclose(quarter.world[:, 0], upright.world[:, 1], atol=0.03)
    np.testing.assert_allclose(quarter.world[:, 1], -upright.world[:, 0], atol=0.03)


def _turned(region, width):
    """Return the region in the image that is turned a quarter to the left."""
    return Region(region.v, width - 1 - region.u, region.side, region.angle - 0.5 * np.pi)


def test_another_file_is_no_model(tmp_path):
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


def test_left_and_right_of_a_man_in_one_camera_are_those_of_four_cameras(data, tmp_path):
    """The network exchanges them in 22 of 99 frames."""
    scene = data / "pose2sim_balance"
    detect_video(scene / "cam02.mp4", tmp_path / "cam02", data / "blazepose" / "pose_landmark_full.tflite")
    detected = read_annotations(tmp_path / "cam02", None, given_times(RATE_HZ))
    camera = next(each for each in load_cameras(scene / "Calib_qualisys.toml") if each.name == "cam_02")
    markers = read_markers(scene / "joints_triangulated.trc")
    true = camera.project(joint_centres(markers, markers.at(detected.frames / RATE_HZ), {}))
    for part in (("elbow", "wrist"), ("knee", "ankle")):
        left, right = ([JOINT_NAMES.index(f"{side}_{limb}") for limb in part] for side in ("left", "right"))
        own, other = (
            np.linalg.norm(detected.pixels[:, left + right] - true[:, order], axis=2).sum(axis=1)
            for order in (left + right, right + left)
        )
        separate = np.linalg.norm(true[:, left] - true[:, right], axis=2).max(axis=1) > 25.0
        assert separate.sum() > 50
        assert not (separate & (other < own)).any()
