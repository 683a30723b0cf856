"""The frames of an edited film are those of the part with the target, and repeated images are counted."""

import cv2
import numpy as np
import pytest
from openpose_scenes import points, standing, write
from video_files import camera_table

from workbench.datasets.multi_view import MultiView
from workbench.datasets.video import Video

N = 12
"""Images of a part."""
WIDTH, HEIGHT = 400, 300
CAMERAS = "".join(camera_table(name, (WIDTH, HEIGHT), 500.0, x_m) for name, x_m in (("left", 0.0), ("right", 0.8)))


def images(folder, seeds):
    """Write images of grey blocks, those of equal seeds alike, which move by 2 px from one image to the next."""
    folder.mkdir()
    for t, seed in enumerate(seeds):
        blocks = np.random.default_rng(seed).integers(0, 255, (HEIGHT // 10, WIDTH // 10), dtype=np.uint8)
        image = np.roll(np.kron(blocks, np.ones((10, 10), np.uint8)), 2 * t, axis=1)
        cv2.imwrite(str(folder / f"{t:02d}.png"), image)
    return folder


@pytest.fixture
def film(tmp_path):
    """Two cameras; the second part, of 18 images, begins at image 12 in the left one, and people in all images."""
    (tmp_path / "cameras.toml").write_text(CAMERAS)
    images(tmp_path / "left", [0] * N + [1] * 18)
    images(tmp_path / "right", [2] * 30)
    for shift, name in enumerate(("left", "right")):
        people = {t: [points("COCO_17", standing(100.0 + 50.0 * shift + t, 40.0))] for t in range(30)}
        write(tmp_path / f"{name}_json", people)
    return tmp_path


@pytest.mark.parametrize("only_visible", [False, True])
def test_the_frames_of_the_part_with_the_target_are_used(film, only_visible, caplog):
    keys = {"keypoints": str(film / "left_json"), "rate_hz": 10.0, "only_visible": only_visible}
    video = Video(str(film / "left"), str(film / "cameras.toml"), **keys)
    assert video.info.input_counts | {"cuts": 1, "part_first": N, "part_last": 29} == video.info.input_counts
    assert [frame.index for frame in video.frames()] == list(range(N, 30))
    assert "cuts at the frames 12" in caplog.text
    assert video.people.numbers == [0, 1]
    first = Video(str(film / "left"), str(film / "cameras.toml"), person=0, **keys)
    assert [frame.index for frame in first.frames()] == list(range(N))
    late = Video(str(film / "left"), str(film / "cameras.toml"), first_frame=N, **keys)
    assert "cuts" not in late.info.input_counts


def test_annotations_by_hand_are_not_split(film):
    (film / "joints.csv").write_text("frame,joint,u,v,visible\n0,neck,31,23,1\n20,neck,31,23,1\n")
    options = {"keypoints": str(film / "joints.csv"), "rate_hz": 10.0}
    assert Video(str(film / "left"), str(film / "cameras.toml"), **options).info.n_frames == 30


@pytest.mark.parametrize("late_s", [0.0, 0.35])
def test_a_cut_in_one_camera_splits_all_views(film, late_s):
    """The left camera is the second of the two; with an offset its frames are paired by time."""
    cameras, options = ["right", "left"], {"rate_hz": 10.0, "offsets_s": {"left": late_s}}
    sources = {name: str(film / name) for name in cameras}
    folders = {name: str(film / f"{name}_json") for name in cameras}
    views = MultiView(sources, str(film / "cameras.toml"), cameras, keypoints=folders, **options)
    first = N if late_s == 0.0 else N + 4
    assert views.info.input_counts["part_first"] == first
    assert next(views.frames()).index == first


def test_repeated_and_frozen_images_are_counted(film):
    for t in range(20, 26):
        (film / "left" / f"{t}.png").write_bytes((film / "left" / "19.png").read_bytes())
    options = {"keypoints": str(film / "left_json"), "rate_hz": 10.0}
    counts = Video(str(film / "left"), str(film / "cameras.toml"), **options).info.input_counts
    assert (counts["frames_repeated"], counts["frames_frozen"]) == (6, 6)
    options["person"] = 0  # in the other part
    assert "frames_repeated" not in Video(str(film / "left"), str(film / "cameras.toml"), **options).info.input_counts


def test_the_ends_of_the_feet_follow_the_target(film):
    """Heel and toes of a detector with feet are in the views, in the scale of their images; others have none."""
    people = {}
    for t in range(30):
        feet = {f"{side}_{end}": (100.0 + t + du, 140.0) for side, du in (("left", 6.0), ("right", -6.0))
                for end in ("heel", "toes")}  # fmt: skip
        people[t] = [points("BODY_25", standing(100.0 + t, 40.0) | feet)]
    folder = write(film / "feet_json", people)
    options = {"calibration_file": str(film / "cameras.toml"), "rate_hz": 10.0, "first_frame": N, "n_frames": 4}
    view = next(Video(str(film / "left"), keypoints=str(folder), scale=0.5, **options).frames()).views[0]
    places = 0.5 * (np.array([[118.0, 140.0], [118.0, 140.0], [106.0, 140.0], [106.0, 140.0]]) + 0.5) - 0.5
    np.testing.assert_allclose(view.feet, np.column_stack([places, np.full(4, 0.8)]))
    assert view.world_landmarks is None
    plain = Video(str(film / "left"), keypoints=str(film / "left_json"), **options)
    assert next(plain.frames()).views[0].feet is None
