"""The video of a recording shows every image with the projected skeletons."""

import cv2
import numpy as np
import pytest
from recorded import record
from recording_steps import BODY, CAMERA, steps, without_images

from workbench.body.kinematics import joints
from workbench.cli.main import main
from workbench.recording.read.reader import read
from workbench.results.overlay import _MIN_OPACITY, MIDDLE, PERSON_CHAINS, drawn, with_omitted_frames, write_overlay
from workbench.results.pictures import Picture, camera_names, pictures
from workbench.utils.errors import InputError

N, FIRST = 6, 10
pytestmark = pytest.mark.usefixtures("trusted")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = list(steps(N, n_particles=20))
    path = record(tmp_path_factory.mktemp("overlay") / "run.rrd", run)
    return read(path), joints(BODY.skeleton, np.stack([step.expected_pose for step in run]))


def test_the_video_shows_every_frame_with_the_estimate(run, tmp_path, capsys):
    recorded, estimated = run
    target = tmp_path / "overlay.mp4"
    assert main(["export", str(recorded.path), "-o", str(target)]) == 0
    assert f"{N} frames; left cyan, right pink, truth blue\n" in capsys.readouterr().out
    video = cv2.VideoCapture(str(target))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0, rel=1e-3)
    images = [video.read()[1] for _ in range(N)]
    assert not video.read()[0]
    assert [file.name for file in tmp_path.iterdir()] == ["overlay.mp4"]
    joints_of_legs = [[BODY.skeleton.joint(f"{side}_{end}") for end in ("knee", "ankle")] for side in ("left", "right")]
    for image, positions in zip(images, estimated, strict=True):
        for side, ends in zip(("left", "right"), joints_of_legs, strict=True):
            u, v = CAMERA.project(positions[ends]).mean(axis=0).round().astype(int)
            blue, green, red = image[v - 1 : v + 2, u - 1 : u + 2].mean(axis=(0, 1))
            assert (blue > red + 20) if side == "left" else (red > green + 20)  # cyan and pink in a grey image


def test_pictures_are_those_of_the_chosen_frames_and_camera(run):
    recorded, _ = run
    frames = recorded.poses[0][[3, 1]].tolist()
    assert [picture.frame for picture in pictures(recorded, frames)] == frames
    assert camera_names(recorded) == [CAMERA.name]
    assert next(pictures(recorded)).image.shape[:2] == (CAMERA.height, CAMERA.width)
    with pytest.raises(InputError, match="no image of frame -1"):
        list(pictures(recorded, [-1]))
    with pytest.raises(InputError, match="no camera 'left', expected one of"):
        list(pictures(recorded, camera="left"))


def test_odd_image_sizes_are_cropped_and_lines_of_other_bodies_have_one_colour():
    line = np.array([[[1.0, 4.0], [7.0, 4.0]]])
    empty = np.empty((0, 2, 2))
    picture = Picture(0, np.zeros((9, 11), np.uint8), {"particles": empty, "estimate": line, "truth": empty})
    image = drawn(picture)
    assert image.shape == (8, 10, 3)
    blue, green, red = image[4, 4].astype(int)
    assert (red, green, blue) == pytest.approx(MIDDLE, abs=40)
    assert not image[:2].any()


def persons_lines():
    """Return lines (5, 4, 2) of a person, each at another height of the image, and where the left ankle is in them."""
    names = [list(chain) for chain in PERSON_CHAINS]
    lines = np.array([[[20.0 + 20.0 * k, 20.0 + 20.0 * row] for k in range(4)] for row in range(len(names))])
    for row, chain in enumerate(names):
        for k in range(1, 4):
            if chain[k] == chain[k - 1]:
                lines[row, k] = lines[row, k - 1]
    return lines, next((row, chain.index("left_ankle")) for row, chain in enumerate(names) if "left_ankle" in chain)


def test_limbs_are_fainter_the_less_confident_the_detector_is():
    lines, (row, k) = persons_lines()
    u, v = lines[row, k - 1 : k + 1].mean(axis=0).astype(int)
    grey = []
    for weight in (1.0, 0.6, 0.0):
        seen = {"left_knee": 1.0, "left_ankle": weight, "left_hip": 1.0}
        image = drawn(Picture(0, np.zeros((140, 120), np.uint8), {"estimate": lines}, seen))
        grey.append(float(image[v, u].max()))
    assert grey == pytest.approx([255.0, 0.6 * 255.0, _MIN_OPACITY * 255.0], abs=2.0)


@pytest.mark.parametrize("far", [np.nan, np.inf, 1e12])
def test_limbs_without_a_place_in_the_image_are_omitted(far):
    lines, (row, _) = persons_lines()
    lines[row, 1:] = far
    image = drawn(Picture(0, np.zeros((140, 120), np.uint8), {"estimate": lines}))
    assert not image[15 + 20 * row : 25 + 20 * row].any()
    assert image.any()


def test_lost_and_omitted_frames_have_a_red_frame():
    lines, _ = persons_lines()
    black = np.zeros((140, 120), np.uint8)
    reds = []
    tracked = Picture(0, black, {"estimate": lines})
    for picture, lost in ((tracked, False), (tracked, True), (Picture(0, black, {}), False)):
        blue, green, red = drawn(picture, lost)[70, 1].astype(int)
        reds.append(red > 200 and blue < 100 and green < 100)
    assert reds == [False, True, True]


def test_frames_that_the_run_omits_come_from_the_source(mp4, tmp_path):
    """The source has FIRST frames before those of the run, and the recording has no images of them."""
    run = steps(N, n_particles=20)
    recorded = read(record(tmp_path / "run.rrd", run, config_yaml="dataset: {n_frames: null}"))
    n, _ = write_overlay(recorded, tmp_path / "overlay.mp4", source=mp4)
    assert n == FIRST + N
    shown = list(with_omitted_frames(pictures(recorded), recorded, mp4))
    assert [picture.frame for picture in shown] == list(range(FIRST + N))
    assert [bool(picture.skeletons) for picture in shown] == [False] * FIRST + [True] * N
    np.testing.assert_allclose([each.image.mean() for each in shown[:FIRST]], 12.0 * np.arange(FIRST), atol=6.0)


@pytest.mark.parametrize("fraction", [0.8, 0.5, 0.3])
def test_reduced_pictures_have_skeletons_at_the_same_places(fraction, run):
    recorded, _ = run
    side = round(fraction * max(CAMERA.width, CAMERA.height))
    whole, small = (next(pictures(recorded, max_side_px=each)) for each in (None, side))
    assert max(small.image.shape[:2]) == side
    scale = np.array(small.image.shape[1::-1]) / (CAMERA.width, CAMERA.height)
    np.testing.assert_allclose(
        (small.skeletons["estimate"] + 0.5) / scale - 0.5, whole.skeletons["estimate"], atol=1e-9
    )
    expected = cv2.resize(whole.image, small.image.shape[1::-1], interpolation=cv2.INTER_AREA)
    grey = small.image if small.image.ndim == 2 else small.image[..., 0]
    np.testing.assert_allclose(grey.mean(), expected.mean(), atol=1.0)
    same = next(pictures(recorded, max_side_px=max(CAMERA.width, CAMERA.height)))
    assert same.image.shape == whole.image.shape


def test_a_recording_without_images_has_no_video(tmp_path, capsys):
    path = record(tmp_path / "run.rrd", without_images(steps(2, n_particles=20)))
    assert main(["export", str(path), "-o", str(tmp_path / "overlay.mp4")]) == 2
    assert "expected images, found none" in capsys.readouterr().err
    assert not (tmp_path / "overlay.mp4").exists()


@pytest.fixture(scope="module")
def mp4(tmp_path_factory):
    """A video whose frame k has the grey level 12 k; the steps start at frame FIRST."""
    path = tmp_path_factory.mktemp("videos") / "grey.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"vp09"), 30.0, (CAMERA.width, CAMERA.height))
    for k in range(FIRST + N):
        writer.write(np.full((CAMERA.height, CAMERA.width, 3), 12 * k, np.uint8))
    writer.release()
    return path


def test_pictures_of_a_recorded_video_are_its_frames(mp4, tmp_path):
    recorded = read(record(tmp_path / "run.rrd", steps(N, n_particles=20), video=True, source_video=mp4))
    numbers = recorded.poses[0].tolist()
    assert numbers == list(range(FIRST, FIRST + N))
    for frames in (numbers, numbers[2:4]):
        shown = list(pictures(recorded, frames))
        assert [picture.frame for picture in shown] == frames
        np.testing.assert_allclose([picture.image.mean() for picture in shown], 12.0 * np.array(frames), atol=6.0)


def test_a_dataset_without_a_readable_video_is_rejected(tmp_path):
    with pytest.raises(InputError, match="expected a dataset of one MP4 video"):
        record(tmp_path / "run.rrd", [], video=True)
    (other := tmp_path / "other.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"other\.mp4: expected a video that Rerun reads"):
        record(tmp_path / "run.rrd", [], video=True, source_video=other)
    assert not any(tmp_path.glob("run.rrd*"))


def test_limbs_with_a_hidden_end_are_not_drawn():
    lines, (row, k) = persons_lines()
    picture = Picture(0, np.zeros((140, 120), np.uint8), {"estimate": lines})
    (u, v), (u_thigh, v_thigh) = (lines[row, at - 1 : at + 1].mean(axis=0).astype(int) for at in (k, k - 1))
    image = drawn(picture, hidden={"left_ankle"})
    assert not image[v, u].any()
    assert image[v_thigh, u_thigh].any()
