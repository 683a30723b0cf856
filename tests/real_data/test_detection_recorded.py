"""People detected in a recorded video by BlazePose's full model, against joints annotated by hand."""

import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.detection import landmark_network
from workbench.datasets.detection.landmark_network import LandmarkNetwork, Region
from workbench.datasets.detection.people_detector import PeopleDetector
from workbench.datasets.files.decode import decode
from workbench.datasets.files.joint_annotations import read_annotations
from workbench.utils.errors import InputError

LANDMARKS = {"shoulder": 11, "elbow": 13, "wrist": 15, "hip": 23, "knee": 25, "ankle": 27}
FRAMES = range(98, 104)


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
