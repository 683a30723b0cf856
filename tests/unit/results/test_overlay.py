"""The video of a recording shows every image with the projected skeletons."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from recording_steps import BODY, CAMERA, SPACE, steps

from workbench.body.kinematics import joints
from workbench.cli.main import main
from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder
from workbench.results.overlay import drawn
from workbench.results.pictures import Picture, pictures
from workbench.utils.errors import InputError

N, FIRST = 6, 10
pytestmark = pytest.mark.usefixtures("trusted")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("overlay") / "run.rrd"
    poses = []
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(N, n_particles=20):
            recorder.log(step, {})
            poses.append(step.expected_pose)
    return read(path), joints(BODY.skeleton, np.stack(poses))


def test_the_video_shows_every_frame_with_the_estimate(run, tmp_path, capsys):
    recorded, estimated = run
    target = tmp_path / "overlay.mp4"
    assert main(["export", str(recorded.path), "-o", str(target)]) == 0
    assert f"{N} frames; estimate orange, truth blue\n" in capsys.readouterr().out
    video = cv2.VideoCapture(str(target))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0, rel=1e-3)
    images = [video.read()[1] for _ in range(N)]
    assert not video.read()[0]
    assert [file.name for file in tmp_path.iterdir()] == ["overlay.mp4"]
    knees = [BODY.skeleton.joint(f"{side}_knee") for side in ("left", "right")]
    for image, positions in zip(images, estimated, strict=True):
        for u, v in CAMERA.project(positions[knees]).round().astype(int):
            blue, _, red = image[v, u].astype(int)
            assert red > blue + 40  # orange in a grey image


def test_a_video_without_truth_does_not_name_its_colour(tmp_path, capsys):
    with Recorder(tmp_path / "run.rrd", BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(2, n_particles=20):
            recorder.log(replace(step, frame=replace(step.frame, truth=None)), {})
    assert main(["export", str(tmp_path / "run.rrd"), "-o", str(tmp_path / "overlay.mp4")]) == 0
    assert capsys.readouterr().out.endswith("estimate orange\n")


def test_pictures_are_those_of_the_chosen_frames_and_camera(run):
    recorded, _ = run
    frames = recorded.poses[0][[3, 1]].tolist()
    assert [picture.frame for picture in pictures(recorded, frames)] == frames
    assert next(pictures(recorded)).image.shape[:2] == (CAMERA.height, CAMERA.width)
    with pytest.raises(InputError, match="no image of frame -1"):
        list(pictures(recorded, [-1]))
    with pytest.raises(InputError, match="no camera 'left', expected one of"):
        list(pictures(recorded, camera="left"))


def test_odd_image_sizes_are_cropped_and_lines_have_their_colour():
    line = np.array([[[1.0, 4.0], [7.0, 4.0]]])
    empty = np.empty((0, 2, 2))
    picture = Picture(0, np.zeros((9, 11), np.uint8), {"particles": empty, "estimate": line, "truth": empty})
    image = drawn(picture)
    assert image.shape == (8, 10, 3)
    blue, green, red = image[4, 4].astype(int)
    assert blue < 5 < green < 100 < 200 < red
    assert not image[:2].any()


def test_a_recording_without_images_has_no_video(tmp_path, capsys):
    path = tmp_path / "run.rrd"
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(2, n_particles=20):
            recorder.log(replace(step, frame=replace(step.frame, views=())), {})
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
    path, labels = tmp_path / "run.rrd", {"run_id": "run", "config_yaml": "", "provenance": {}}
    with Recorder(path, BODY, SPACE, **labels, video=True, source_video=mp4) as recorder:
        for step in steps(N, n_particles=20):
            recorder.log(step, {})
    recorded = read(path)
    numbers = recorded.poses[0].tolist()
    assert numbers == list(range(FIRST, FIRST + N))
    for frames in (numbers, numbers[2:4]):
        shown = list(pictures(recorded, frames))
        assert [picture.frame for picture in shown] == frames
        np.testing.assert_allclose([picture.image.mean() for picture in shown], 12.0 * np.array(frames), atol=6.0)


def test_a_dataset_without_a_readable_video_is_rejected(tmp_path):
    labels = {"run_id": "run", "config_yaml": "", "provenance": {}}
    with pytest.raises(InputError, match="expected a dataset of one MP4 video"):
        Recorder(tmp_path / "run.rrd", BODY, SPACE, **labels, video=True)
    (other := tmp_path / "other.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"other\.mp4: expected a video that Rerun reads"):
        Recorder(tmp_path / "run.rrd", BODY, SPACE, **labels, video=True, source_video=other)
    assert not any(tmp_path.glob("run.rrd*"))
