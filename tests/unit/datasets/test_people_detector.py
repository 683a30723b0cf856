"""People are detected in every frame by a network that is stood in for by discs painted into images."""

import json

import cv2
import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.camera_calibration.camera_file import write_cameras
from workbench.datasets.detection import detection_files
from workbench.datasets.detection.detection_files import detect_video
from workbench.datasets.detection.landmark_network import N_LANDMARKS, SIZE_PX, PersonLandmarks, Region, refined
from workbench.datasets.detection.people_detector import PeopleDetector, grid
from workbench.datasets.multi_view import MultiView
from workbench.datasets.video import Video
from workbench.utils.errors import InputError

WIDTH, HEIGHT, RADIUS = 320, 180, 12
SHAPE = np.random.default_rng(0).uniform(-1.0, 1.0, (N_LANDMARKS, 2))


def image(*centres):
    """An image with a disc of its own grey level for each person."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for k, (u, v) in enumerate(centres):
        cv2.circle(pixels, (round(u), round(v)), RADIUS, (100 + 20 * k,) * 3, -1)
    return pixels


def network(pixels, region):
    """Find the largest disc in the region; the presence is high where the region is about five radii wide."""
    crop = cv2.warpAffine(pixels, region.to_image, (SIZE_PX, SIZE_PX), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    n, _, sizes, centres = cv2.connectedComponentsWithStats((crop[..., 0] > 50).astype(np.uint8))
    if n < 2:
        return PersonLandmarks(
            np.zeros((N_LANDMARKS, 2)), np.zeros(N_LANDMARKS), np.zeros((N_LANDMARKS, 3)), 0.0, region
        )
    centre = region.to_image[:, :2] @ centres[1 + sizes[1:, cv2.CC_STAT_AREA].argmax()] + region.to_image[:, 2]
    presence = float(np.exp(-(np.log(region.side / (5.0 * RADIUS)) ** 2)))
    around = Region(float(centre[0]), float(centre[1]), 5.0 * RADIUS)
    return PersonLandmarks(centre + RADIUS * SHAPE, np.ones(N_LANDMARKS), np.zeros((N_LANDMARKS, 3)), presence, around)


def centres(people):
    return {person.number: (person.landmarks.pixels - RADIUS * SHAPE).mean(axis=0) for person in people}


def test_the_grid_covers_every_place_by_some_square_in_the_image():
    regions = list(grid(WIDTH, HEIGHT))
    places = np.random.default_rng(1).uniform([0.0, 0.0], [WIDTH, HEIGHT], (200, 2))
    small = [region for region in regions if region.side < 0.5 * WIDTH]
    for u, v in places:
        assert any(max(abs(u - each.u), abs(v - each.v)) <= 0.5 * each.side for each in small)


def test_the_map_of_a_region_puts_its_centre_and_its_up_where_they_are():
    region = Region(100.0, 50.0, 80.0, 0.5 * np.pi)
    np.testing.assert_allclose(region.to_image @ [128.0, 128.0, 1.0], [100.0, 50.0])
    np.testing.assert_allclose(region.to_image @ [128.0, 0.0, 1.0], [140.0, 50.0])  # up is the image's right


def test_a_landmark_is_moved_to_the_middle_of_its_heat():
    heat = np.full((2, 64, 64), -20.0)
    heat[0, 20, 30:32] = 3.0
    result = refined(np.array([[29.0, 21.0], [10.0, 10.0]]) * 4.0, heat)
    np.testing.assert_allclose(result, [[30.5 * 4.0, 20.0 * 4.0], [40.0, 40.0]])


def test_two_people_are_followed_and_keep_their_numbers():
    paths = [[(60.0 + 4.0 * t, 60.0), (250.0 - 4.0 * t, 130.0)] for t in range(25)]
    frames = list(PeopleDetector(network, 10).detect(image(*places) for places in paths))
    order = [number for number, _ in sorted(centres(frames[0]).items(), key=lambda item: item[1][1])]
    for places, people in zip(paths, frames, strict=True):
        found = centres(people)
        assert set(found) == {0, 1}
        both = sorted(found.items(), key=lambda item: item[1][1])
        np.testing.assert_allclose([centre for _, centre in both], places, atol=1.0)
        assert [number for number, _ in both] == order


def test_a_person_who_enters_late_and_leaves_is_in_exactly_those_frames():
    there = range(13, 31)
    images = [image((100.0 + 3.0 * (t - 13), 90.0)) if t in there else image() for t in range(40)]
    shown = [bool(people) for people in PeopleDetector(network, 10).detect(images)]
    assert [t for t, seen in enumerate(shown) if seen] == list(there)


def test_nobody_is_found_in_empty_images():
    assert list(PeopleDetector(network, 4).detect([image()] * 6)) == [[]] * 6


@pytest.fixture
def video(tmp_path, monkeypatch):
    """A folder of images, the network above in place of a model, and chunks of four frames."""
    folder = tmp_path / "walk"
    folder.mkdir()
    for t in range(11):
        cv2.imwrite(str(folder / f"{t:03d}.png"), image((40.0 + 10.0 * t, 90.0)))
    (tmp_path / "model").write_bytes(b"a model")
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda path: network)
    monkeypatch.setattr(detection_files, "_CHUNK_S", 4.0 / 30.0)
    return folder


def contents(folder):
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


def test_detections_that_were_cut_off_are_resumed_with_the_same_result(video, tmp_path):
    whole, part = tmp_path / "whole", tmp_path / "part"
    assert detect_video(video, whole, tmp_path / "model") == 11
    detect_video(video, part, tmp_path / "model")
    for path in sorted(part.glob("*.json"))[6:]:
        path.unlink()
    assert detect_video(video, part, tmp_path / "model") == 11
    assert contents(part) == contents(whole)
    frame = json.loads((whole / "walk_000000000003_keypoints.json").read_text())
    assert frame["time_s"] == pytest.approx(0.1)
    (person,) = frame["people"]
    assert len(person["pose_keypoints_2d"]) == 3 * N_LANDMARKS


def test_files_of_another_model_are_not_mixed_with_new_ones(video, tmp_path):
    detect_video(video, tmp_path / "out", tmp_path / "model")
    (tmp_path / "model").write_bytes(b"another model")
    with pytest.raises(InputError, match="another video or model"):
        detect_video(video, tmp_path / "out", tmp_path / "model")


def test_a_damaged_file_is_refused(video, tmp_path):
    detect_video(video, tmp_path / "out", tmp_path / "model")
    path = sorted((tmp_path / "out").glob("*.json"))[7]
    source = json.loads(path.read_text())["source"]
    for later in sorted((tmp_path / "out").glob("*.json"))[8:]:
        later.unlink()
    path.write_text(json.dumps({"source": source, "people": [{"person_id": [0]}]}))
    with pytest.raises(InputError, match="expected detections"):
        detect_video(video, tmp_path / "out", tmp_path / "model")


@pytest.fixture
def camera_file(tmp_path):
    camera = plain_camera(WIDTH, HEIGHT, 300.0, (0.0, -5.0, 1.0), (0.0, 0.0, 1.0), "walk")
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    return str(tmp_path / "camera.toml")


def test_a_dataset_detects_once_and_shows_the_joints(video, camera_file, tmp_path, monkeypatch):
    options = {"rate_hz": 30.0, "detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache")}
    dataset = Video(str(video), camera_file, keypoints="detect", **options)
    assert dataset.info.has_keypoints
    keypoints = next(iter(dataset.frames())).views[0].keypoints
    left_hip = [40.0, 90.0] + RADIUS * SHAPE[23]
    np.testing.assert_allclose(keypoints[JOINT_NAMES.index("left_hip"), :2], left_hip, atol=1.0)
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda path: pytest.fail("detects again"))
    assert Video(str(video), camera_file, keypoints="detect", **options).info.has_keypoints


def test_several_views_detect_each_in_its_video(video, camera_file, tmp_path):
    options = {"rate_hz": 30.0, "detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache")}
    dataset = MultiView({"walk": str(video)}, camera_file, keypoints="detect", **options)
    assert np.isfinite(next(iter(dataset.frames())).views[0].keypoints).any()
    with pytest.raises(InputError, match="expected files by camera or 'detect'"):
        MultiView({"walk": str(video)}, camera_file, keypoints="found", **options)


def test_only_frames_with_the_person_are_used_where_that_is_chosen(video, camera_file, tmp_path):
    for t in (0, 1, 10):
        cv2.imwrite(str(video / f"{t:03d}.png"), image())
    options = {"rate_hz": 30.0, "detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache")}
    dataset = Video(str(video), camera_file, keypoints="detect", only_visible=True, **options)
    assert [frame.index for frame in dataset.frames()] == list(range(2, 10))
    assert Video(str(video), camera_file, keypoints="detect", **options).info.n_frames == 11


def test_the_one_who_moves_is_followed_where_that_is_chosen(video, camera_file, tmp_path):
    for t in range(11):
        cv2.imwrite(str(video / f"{t:03d}.png"), image((40.0, 50.0), (280.0 - 3.0 * t, 130.0)))
    options = {"rate_hz": 30.0, "detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache")}
    dataset = Video(str(video), camera_file, keypoints="detect", person="moving", **options)
    hips = [frame.views[0].keypoints[JOINT_NAMES.index("left_hip")] for frame in dataset.frames()]
    assert hips[-1][0] - hips[0][0] == pytest.approx(-30.0, abs=2.0)


@pytest.fixture
def gap(tmp_path, monkeypatch):
    """A folder of images in which the person is absent from frame 6 to 25, and options of a dataset of it."""
    (tmp_path / "gap").mkdir()
    for t in range(34):
        absent = t < 2 or 6 <= t < 26
        cv2.imwrite(str(tmp_path / "gap" / f"{t:03d}.png"), image() if absent else image((90.0 + 0.5 * t, 90.0)))
    (tmp_path / "model").write_bytes(b"a model")
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda path: network)
    monkeypatch.setattr(detection_files, "_CHUNK_S", 4.0 / 30.0)
    camera = plain_camera(WIDTH, HEIGHT, 300.0, (0.0, -5.0, 1.0), (0.0, 0.0, 1.0), "walk")
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    options = {"detector": str(tmp_path / "model"), "cache": str(tmp_path / "cache"), "only_visible": True}
    return str(tmp_path / "gap"), str(tmp_path / "camera.toml"), options


PRESENT = [*range(2, 6), *range(26, 34)]


def test_frames_of_a_long_gap_are_omitted_and_those_of_a_short_one_are_not(gap):
    source, camera, options = gap
    dataset = Video(source, camera, keypoints="detect", rate_hz=30.0, **options)
    assert [(frame.index, round(30.0 * frame.time_s)) for frame in dataset.frames()] == [(t, t) for t in PRESENT]
    assert dataset.info.n_frames == len(PRESENT)
    short = Video(source, camera, keypoints="detect", rate_hz=60.0, **options)
    assert [frame.index for frame in short.frames()] == list(range(2, 34))


def test_frames_between_annotations_are_no_gap(gap, tmp_path):
    source, camera, options = gap
    rows = [f"{frame},left_hip,90,90,1" for frame in (3, 30)]
    (tmp_path / "marks.csv").write_text("\n".join(["frame,joint,u,v,visible", *rows]))
    dataset = Video(source, camera, keypoints=str(tmp_path / "marks.csv"), rate_hz=30.0, **options)
    assert [frame.index for frame in dataset.frames()] == list(range(3, 31))


def test_several_cameras_omit_the_frames_in_which_none_shows_the_person(gap, tmp_path):
    source, camera, options = gap
    dataset = MultiView({"walk": source}, camera, keypoints="detect", rate_hz=30.0, **options)
    assert [frame.index for frame in dataset.frames()] == PRESENT
    assert dataset.info.n_frames == len(PRESENT)
