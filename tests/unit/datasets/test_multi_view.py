"""The dataset of several cameras: order of views, keypoints by camera, the target person and the ground truth."""

import cv2
import numpy as np
import pytest
from openpose_scenes import points, standing, write
from video_files import camera_table

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.multi_view import MultiView
from workbench.motion.formats.motion_export import trc_text
from workbench.utils.errors import InputError

CAMERAS = "".join(camera_table(name, (400, 300), 500.0, x_m) for name, x_m in (("left", 0.0), ("right", 0.8)))
"""A point at a depth of 8 m is 50 pixels farther to the right in the second camera."""
LENGTHS = {"left": 6, "right": 5}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Images of grey level 10 t, keypoints that move 1 px per frame, and a ground truth that moves 1 m per frame."""
    folder = tmp_path_factory.mktemp("scene")
    (folder / "cameras.toml").write_text(CAMERAS)
    for shift, (name, n) in enumerate(LENGTHS.items()):
        (folder / name).mkdir()
        for t in range(n):
            cv2.imwrite(str(folder / name / f"{t}.png"), np.full((300, 400, 3), 10 * t + shift, np.uint8))
        detections = {t: [points("COCO_17", standing(100.0 + 50.0 * shift + t, 40.0))] for t in range(n)}
        write(folder / f"{name}_json", detections)
    heights = np.array([{"neck": 1.5, "left_ankle": 0.1}.get(name, np.nan) for name in JOINT_NAMES])
    places = np.stack([np.column_stack([np.full(15, t), np.zeros(15), heights]) for t in range(4)])
    places[np.isnan(places).any(axis=2)] = np.nan
    (folder / "truth.trc").write_text(trc_text("truth.trc", JOINT_NAMES, places, 10.0))
    return folder


def dataset(scene, **changes):
    options = {
        "sources": {name: str(scene / name) for name in LENGTHS}, "calibration_file": str(scene / "cameras.toml"),
        "keypoints": {name: str(scene / f"{name}_json") for name in LENGTHS}, "rate_hz": 10.0,
    }  # fmt: skip
    return MultiView(**{**options, **changes})


def test_cameras_without_a_size_have_that_of_the_images_and_the_unit_of_the_file(scene, tmp_path):
    lens = "K: [[500.0, 0.0, 199.5], [0.0, 500.0, 149.5], [0.0, 0.0, 1.0]], D: [0.0, 0.0, 0.0, 0.0], unit: cm"
    rig = (
        f"left: {{{lens}, R: [1.57, 0, 0], T: [0, 100, 400]}}\nright: {{{lens}, R: [1.57, 0, 0], T: [80, 100, 400]}}\n"
    )
    (tmp_path / "rig.yml").write_text(rig)
    expected = dataset(scene, unit="m").info.cameras
    for one, other in zip(
        dataset(scene, calibration_file=str(tmp_path / "rig.yml")).info.cameras, expected, strict=True
    ):
        assert (one.width, one.height) == (400, 300)
        np.testing.assert_allclose(one.row, other.row, atol=1e-12)


def test_frames_have_a_view_of_every_camera_up_to_the_end_of_the_shortest(scene):
    two_views = dataset(scene, first_frame=1)
    assert (two_views.info.n_frames, two_views.info.name) == (4, "left, right")
    frames = list(two_views.frames())
    assert [frame.index for frame in frames] == [1, 2, 3, 4]
    shoulder = JOINT_NAMES.index("left_shoulder")
    for frame in frames:
        assert [view.camera.name for view in frame.views] == ["left", "right"]
        assert [int(view.image[0, 0, 0]) for view in frame.views] == [10 * frame.index, 10 * frame.index + 1]
        columns = [view.keypoints[shoulder, 0] for view in frame.views]
        assert columns == pytest.approx([112.0 + frame.index, 162.0 + frame.index])


def test_cameras_are_selected_and_ordered_by_name(scene):
    frames = list(dataset(scene, cameras=["right"], scale=0.5).frames())
    assert [view.camera.name for view in frames[0].views] == ["right"]
    assert frames[0].views[0].image.shape == (150, 200, 3)
    assert frames[2].views[0].keypoints[JOINT_NAMES.index("left_shoulder"), 0] == pytest.approx(0.5 * 164.5 - 0.5)
    swapped = next(dataset(scene, cameras=["right", "left"], keypoints={}).frames())
    assert [view.camera.name for view in swapped.views] == ["right", "left"]
    assert all(view.keypoints is None for view in swapped.views)


def test_the_target_is_selected_by_an_index_in_any_view(scene, tmp_path):
    folders = {}
    for shift, (name, n) in enumerate(LENGTHS.items()):
        first, second = ([standing(u + 50.0 * shift + t, 40.0) for t in range(n)] for u in (100.0, 250.0))
        both = [
            [points("COCO_17", joints, confidence) for joints, confidence in ((a, 0.5), (b, 0.9))]
            for a, b in zip(first, second, strict=True)
        ]
        folders[name] = str(write(tmp_path / name, {t: both[t][:: -1 if (t + shift) % 2 else 1] for t in range(n)}))
    head = JOINT_NAMES.index("head_centre")

    def heads(person):
        frames = dataset(scene, keypoints=folders, person=person).frames()
        return [[float(view.keypoints[head, 0]) for view in frame.views] for frame in frames]

    for person in (0, {"left": 0}, {"right": 1}, {"left": 0, "right": 1}):
        np.testing.assert_allclose(heads(person), [[100.0 + t, 150.0 + t] for t in range(5)])
    for person in (None, 1, {"right": 0}):  # the default is the higher confidence at equal sizes
        np.testing.assert_allclose(heads(person), [[250.0 + t, 300.0 + t] for t in range(5)])
    info = dataset(scene, keypoints=folders).info
    assert {name: n for name, n in info.input_counts.items() if n} == {"people": 2, "frames": 5}
    assert info.has_keypoints
    for person, message in (
        (2, "no person 2, expected 0 to 1"),
        ({"left": 2}, "left: no person 2 in frame 0, the first with detections; expected 0 to 1"),
        ({"left": 0, "right": 0}, "expected indices of one person, found 2 people: 0 of left, 0 of right"),
        ("all", "sweep over the numbers"),
        ({"middle": 0}, "some of left, right"),
    ):
        with pytest.raises(InputError, match=message):
            _ = dataset(scene, keypoints=folders, person=person).info


@pytest.mark.parametrize(("first", "positions_m"), [(0, [1, 2, 3, np.nan]), (2, [np.nan, 0, 1, 2])])
def test_the_ground_truth_begins_at_its_first_frame(scene, first, positions_m):
    neck = JOINT_NAMES.index("neck")
    neck_x = [
        frame.truth.joints[neck, 0]
        for frame in dataset(scene, truth=str(scene / "truth.trc"), truth_first_frame=first, first_frame=1).frames()
    ]  # fmt: skip
    np.testing.assert_allclose(neck_x, positions_m, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cameras": ["middle"]}, "no source for camera 'middle', expected one of left, right"),
        ({"keypoints": {"middle": "x"}}, "no source for camera 'middle'"),
        ({"cameras": []}, "expected one camera or more, each once, found none"),
        ({"cameras": ["left", "left"]}, "expected one camera or more, each once, found left, left"),
        ({"truth": "nowhere.trc"}, "no such file"),
        ({"n_frames": 6}, "no frame 5"),
    ],
)
def test_inconsistent_options_are_an_error(scene, changes, message):
    with pytest.raises(InputError, match=message):
        _ = dataset(scene, **changes).info


def test_images_of_nearly_the_cameras_size_are_stretched_and_others_rejected(scene, tmp_path):
    for width in (397, 380):
        (tmp_path / str(width)).mkdir()
        for t in range(2):
            cv2.imwrite(str(tmp_path / str(width) / f"{t}.png"), np.zeros((300, width, 3), np.uint8))
    near, far = (
        dataset(scene, sources={"left": str(tmp_path / width)}, keypoints={}, scale=0.5) for width in ("397", "380")
    )
    with pytest.warns(UserWarning, match="397×300 are stretched to the camera's 400×300"):
        assert next(near.frames()).views[0].image.shape == (150, 200, 3)
    with pytest.raises(InputError, match="images are 380×300, expected the 400×300"):
        _ = far.info
