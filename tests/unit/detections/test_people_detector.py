"""Detection of people in every frame; discs take the place of people, and a disc detector that of the network."""

import json
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import plain_camera
from workbench.cameras.camera_file import write_cameras
from workbench.datasets.multi_view import MultiView
from workbench.datasets.video import Video
from workbench.detections.detector import detection_files
from workbench.detections.detector.detection_files import detect_video
from workbench.detections.detector.landmark_network import N_LANDMARKS, SIZE_PX, PersonLandmarks, Region, refined
from workbench.detections.detector.people_detector import PeopleDetector, grid
from workbench.utils.errors import InputError

WIDTH, HEIGHT, RADIUS = 320, 180, 12
SHAPE = np.random.default_rng(0).uniform(-1.0, 1.0, (N_LANDMARKS, 2))


def image(*centres):
    """Draw a disc for each person, with different grey levels."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for k, (u, v) in enumerate(centres):
        cv2.circle(pixels, (round(u), round(v)), RADIUS, (100 + 20 * k,) * 3, -1)
    return pixels


def network(pixels, region):
    """Detect the largest disc in the region; the presence is highest for regions five radii wide."""
    crop = cv2.warpAffine(pixels, region.to_image, (SIZE_PX, SIZE_PX), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    n, _, sizes, centres = cv2.connectedComponentsWithStats((crop[..., 0] > 50).astype(np.uint8))
    if n < 2:
        return PersonLandmarks(
            np.zeros((N_LANDMARKS, 2)), np.zeros(N_LANDMARKS), np.zeros((N_LANDMARKS, 3)), 0.0, region
        )
    centre = region.to_image[:, :2] @ centres[1 + sizes[1:, cv2.CC_STAT_AREA].argmax()] + region.to_image[:, 2]
    presence = float(np.exp(-(np.log(region.side / (5.0 * RADIUS)) ** 2)))
    next_region = Region(float(centre[0]), float(centre[1]), 5.0 * RADIUS)
    return PersonLandmarks(
        centre + RADIUS * SHAPE, np.ones(N_LANDMARKS), np.zeros((N_LANDMARKS, 3)), presence, next_region
    )


def centres(people):
    return {person.number: (person.landmarks.pixels - RADIUS * SHAPE).mean(axis=0) for person in people}


def test_the_grid_covers_every_position_in_the_image():
    regions = list(grid(WIDTH, HEIGHT))
    positions = np.random.default_rng(1).uniform([0.0, 0.0], [WIDTH, HEIGHT], (200, 2))
    small = [region for region in regions if region.side < 0.5 * WIDTH]
    for u, v in positions:
        assert any(max(abs(u - region.u), abs(v - region.v)) <= 0.5 * region.side for region in small)


def test_a_region_maps_its_centre_and_its_upward_direction_to_the_image():
    region = Region(100.0, 50.0, 80.0, 0.5 * np.pi)
    np.testing.assert_allclose(region.to_image @ [128.0, 128.0, 1.0], [100.0, 50.0])
    np.testing.assert_allclose(region.to_image @ [128.0, 0.0, 1.0], [140.0, 50.0])  # upwards is to the right


def test_a_landmark_is_refined_to_the_centre_of_its_heatmap():
    heat = np.full((2, 64, 64), -20.0)
    heat[0, 20, 30:32] = 3.0
    result = refined(np.array([[29.0, 21.0], [10.0, 10.0]]) * 4.0, heat)
    np.testing.assert_allclose(result, [[30.5 * 4.0, 20.0 * 4.0], [40.0, 40.0]])


def test_two_people_have_the_same_numbers_in_all_frames():
    paths = [[(60.0 + 4.0 * t, 60.0), (250.0 - 4.0 * t, 130.0)] for t in range(25)]
    frames = list(PeopleDetector(network, 10).detect(image(*expected) for expected in paths))
    order = [number for number, _ in sorted(centres(frames[0]).items(), key=lambda item: item[1][1])]
    for expected, people in zip(paths, frames, strict=True):
        positions = centres(people)
        assert set(positions) == {0, 1}
        by_height = sorted(positions.items(), key=lambda item: item[1][1])
        np.testing.assert_allclose([centre for _, centre in by_height], expected, atol=1.0)
        assert [number for number, _ in by_height] == order


def test_a_person_is_detected_in_exactly_the_frames_with_the_person():
    present = range(13, 31)
    images = [image((100.0 + 3.0 * (t - 13), 90.0)) if t in present else image() for t in range(40)]
    detected = [bool(people) for people in PeopleDetector(network, 10).detect(images)]
    assert [t for t, is_detected in enumerate(detected) if is_detected] == list(present)


def test_people_are_the_same_by_any_number_of_threads():
    images = [image((60.0 + 4.0 * t, 60.0), (250.0 - 4.0 * t, 130.0)) for t in range(25)]
    n_threads, found = numba.get_num_threads(), []
    try:
        for n in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(n)
            found.append(list(PeopleDetector(network, 10).detect(images)))
    finally:
        numba.set_num_threads(n_threads)
    for one, other in zip(*found, strict=True):
        assert [person.number for person in one] == [person.number for person in other]
        for person, same in zip(one, other, strict=True):
            np.testing.assert_array_equal(person.landmarks.pixels, same.landmarks.pixels)


@pytest.fixture
def options(tmp_path, monkeypatch):
    """Options of a dataset; `network` detects in chunks of four frames."""
    (tmp_path / "model").write_bytes(b"a model")
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda path: network)
    monkeypatch.setattr(detection_files, "_CHUNK_S", 4.0 / 30.0)
    camera = plain_camera(WIDTH, HEIGHT, 300.0, (0.0, -5.0, 1.0), (0.0, 0.0, 1.0), "walk")
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    return {
        "calibration_file": str(tmp_path / "camera.toml"), "keypoints": "detect", "rate_hz": 30.0,
        "detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache"),
    }  # fmt: skip


def write_images(folder, images):
    folder.mkdir(exist_ok=True)
    for t, pixels in enumerate(images):
        cv2.imwrite(str(folder / f"{t:03d}.png"), pixels)
    return str(folder)


@pytest.fixture
def walk(tmp_path):
    return write_images(tmp_path / "walk", [image((40.0 + 10.0 * t, 90.0)) for t in range(11)])


@pytest.fixture
def detect(walk, options, tmp_path):
    """Detect the walking disc and write the files to a folder of this name."""
    return lambda name="out": detect_video(Path(walk), tmp_path / name, Path(options["detector"]))


def test_resumed_detections_are_identical(detect, tmp_path):
    assert detect("complete") == 11
    detect("resumed")
    for path in sorted((tmp_path / "resumed").glob("*.json"))[6:]:
        path.unlink()
    assert detect("resumed") == 11
    complete, resumed = (
        {path.name: path.read_text() for path in (tmp_path / name).iterdir()} for name in ("complete", "resumed")
    )
    assert resumed == complete
    frame = json.loads(complete["walk_000000000003_keypoints.json"])
    assert frame["time_s"] == pytest.approx(0.1)
    (person,) = frame["people"]
    assert len(person["pose_keypoints_2d"]) == 3 * N_LANDMARKS


def test_detections_of_another_model_are_rejected(detect, tmp_path):
    detect()
    (tmp_path / "model").write_bytes(b"another model")
    with pytest.raises(InputError, match="another video or model"):
        detect()


def test_a_damaged_detection_file_is_rejected(detect, tmp_path):
    detect()
    path, *later = sorted((tmp_path / "out").glob("*.json"))[7:]
    source = json.loads(path.read_text())["source"]
    for file in later:
        file.unlink()
    path.write_text(json.dumps({"source": source, "people": [{"person_id": [0]}]}))
    with pytest.raises(InputError, match="expected detections"):
        detect()


def test_a_dataset_detects_joints_once(walk, options, monkeypatch):
    dataset = Video(walk, **options)
    assert dataset.info.has_keypoints
    keypoints = next(iter(dataset.frames())).views[0].keypoints
    left_hip = [40.0, 90.0] + RADIUS * SHAPE[23]
    np.testing.assert_allclose(keypoints[JOINT_NAMES.index("left_hip"), :2], left_hip, atol=1.0)
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda path: pytest.fail("detects again"))
    assert Video(walk, **options).info.has_keypoints


def test_the_moving_person_can_be_selected(tmp_path, options):
    images = [image((40.0, 50.0), (280.0 - 3.0 * t, 130.0)) for t in range(11)]
    dataset = Video(write_images(tmp_path / "two", images), person="moving", **options)
    hips = [frame.views[0].keypoints[JOINT_NAMES.index("left_hip")] for frame in dataset.frames()]
    assert hips[-1][0] - hips[0][0] == pytest.approx(-30.0, abs=2.0)


PRESENT = [*range(2, 6), *range(26, 34)]


@pytest.fixture
def gap(tmp_path):
    """A video with the person in the frames PRESENT."""
    images = [image((90.0 + 0.5 * t, 90.0)) if t in PRESENT else image() for t in range(36)]
    return write_images(tmp_path / "gap", images)


def test_frames_between_annotations_are_used(gap, options, tmp_path):
    rows = [f"{frame},left_hip,90,90,1" for frame in (3, 30)]
    (tmp_path / "annotations.csv").write_text("\n".join(["frame,joint,u,v,visible", *rows]))
    dataset = Video(gap, only_visible=True, **{**options, "keypoints": str(tmp_path / "annotations.csv")})
    assert [frame.index for frame in dataset.frames()] == list(range(3, 31))


def test_frames_without_the_person_in_any_camera_are_omitted(gap, options, tmp_path):
    folder = Path(gap).rename(tmp_path / "walk")
    dataset = MultiView({"walk": str(folder)}, only_visible=True, **options)
    assert [frame.index for frame in dataset.frames()] == PRESENT
    assert dataset.info.n_frames == len(PRESENT)


def frames_of(folder):
    return {path.name: path.read_text() for path in folder.glob("*.json")}


def test_only_the_chunks_of_the_frames_used_are_detected_and_a_longer_run_continues(walk, options, detect, tmp_path):
    detect("complete")
    model, folder = Path(options["detector"]), tmp_path / "short"
    assert detect_video(Path(walk), folder, model, (0, 4)) == 8
    detected = frames_of(folder)
    assert detect_video(Path(walk), folder, model, (2, 7)) == 8
    assert detect_video(Path(walk), folder, model, (0, 8)) == 11
    complete = frames_of(tmp_path / "complete")
    assert frames_of(folder) == complete
    assert detected == {name: complete[name] for name in sorted(complete)[:8]}
    assert detect_video(Path(walk), tmp_path / "late", model, (6, 7)) == 4
    assert sorted(frames_of(tmp_path / "late")) == sorted(complete)[4:8]


def test_numbers_of_people_who_left_are_not_given_again(options, tmp_path):
    moving = [[(40.0, 90.0)] * (t < 5) + [(200.0, 60.0)] * (t < 7) + [(120.0, 130.0)] * (t > 8) for t in range(12)]
    video = Path(write_images(tmp_path / "people", [image(*centres) for centres in moving]))
    model = Path(options["detector"])
    detect_video(video, tmp_path / "complete", model)
    for last in (3, 7, None):
        detect_video(video, tmp_path / "resumed", model, (0, last))
    assert frames_of(tmp_path / "resumed") == frames_of(tmp_path / "complete")


def test_frames_without_a_person_are_reported_with_the_name_of_the_video(gap, options):
    with pytest.raises(InputError, match=f"^{gap}: expected a person, found none in 2 frames$"):
        _ = Video(gap, n_frames=2, **options).info
