"""Videos from folders of images and files: numbering, colours, scale, annotations and errors."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import load_cameras
from workbench.datasets.video import Video
from workbench.utils.decode import count_frames, decode, image_files
from workbench.utils.errors import InputError

WIDTH, HEIGHT = 64, 48
NECK, ANKLE = JOINT_NAMES.index("neck"), JOINT_NAMES.index("left_ankle")
CAMERA = """
[{name}]
size = [{width}, {height}]
matrix = [[80.0, 0.0, 31.0], [0.0, 80.0, 23.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [1.2, 1.2, -1.2]
translation = [0.0, 0.0, 4.0]
"""


def numbered_image(number):
    """Return an image whose red channel is its number."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 2] = number
    image[..., 0] = 200
    return image


@pytest.fixture
def scene(tmp_path):
    """A folder of 12 numbered images, their cameras, and annotations in images 3 and 10."""
    (tmp_path / "images").mkdir()
    for number in range(12):
        cv2.imwrite(str(tmp_path / "images" / f"img_{number}.png"), numbered_image(number))
    (tmp_path / "images" / "notes.txt").write_text("no image")
    tables = [CAMERA.format(name=name, width=WIDTH, height=HEIGHT) for name in ("left", "right")]
    (tmp_path / "camera.toml").write_text("".join(tables))
    annotations = "3,neck,31,23,1\n3,left_ankle,10.5,40,0\n10,neck,5,6,1\n"
    (tmp_path / "annotations.csv").write_text("frame,joint,u,v,visible\n" + annotations)
    return tmp_path


def video(scene, **parameters):
    annotation_options = ("initial_annotations", "eval_annotations", "keypoints")
    paths = {name: str(scene / value) for name, value in parameters.items() if name in annotation_options}
    source = scene / parameters.pop("source", "images")
    camera = scene / parameters.pop("calibration_file", "camera.toml")
    return Video(str(source), str(camera), **{"rate_hz": 25.0, **parameters, **paths})


def error_message(scene, **parameters):
    with pytest.raises(InputError) as error:
        _ = video(scene, **parameters).info
    return str(error.value)


def test_images_are_read_in_natural_order_with_their_numbers_and_times(scene):
    dataset = video(scene, first_frame=2, n_frames=9)
    frames = list(dataset.frames())
    assert [frame.index for frame in frames] == list(range(2, 11))
    assert [int(frame.views[0].image[0, 0, 0]) for frame in frames] == list(range(2, 11))  # img_10 after img_9
    assert frames[0].views[0].image[0, 0, 2] == 200  # RGB: blue is last
    assert frames[3].time_s == pytest.approx(5 / 25.0)
    assert dataset.info.n_frames == 9
    assert [frame.index for frame in dataset.frames()] == list(range(2, 11))  # frames can be iterated again
    assert video(scene).info.n_frames == 12
    assert [frame.index for frame in video(scene, first_frame=2).frames()] == list(range(2, 12))


def test_annotations_define_the_initial_keypoints_and_the_truth(scene):
    annotations = {"initial_annotations": "annotations.csv", "eval_annotations": "annotations.csv"}
    dataset = video(scene, first_frame=3, occluded_weight=0.2, **annotations)
    (start,) = dataset.info.initial_annotations.keypoints
    assert np.array_equal(start[NECK], [31.0, 23.0, 1.0])
    assert np.array_equal(start[ANKLE], [10.5, 40.0, 0.2])
    assert np.isnan(np.delete(start, [NECK, ANKLE], axis=0)).all()
    truths = {frame.index: frame.truth for frame in dataset.frames()}
    assert [index for index, truth in truths.items() if truth is not None] == [3, 10]
    assert np.array_equal(truths[3].annotations[ANKLE], [10.5, 40.0])
    assert truths[3].annotations_visible[NECK]
    assert not truths[3].annotations_visible[ANKLE]
    assert np.isfinite(truths[10].annotations).sum() == 2


def test_initial_annotations_may_include_later_frames(scene):
    options = {"first_frame": 3, "initial_annotations": "annotations.csv"}
    up_to_10, up_to_9 = (video(scene, initial_last_frame=t, **options).info.initial_annotations for t in (10, 9))
    assert up_to_10.times_s == pytest.approx([3 / 25.0, 10 / 25.0])
    assert np.array_equal(up_to_10.keypoints[1, NECK], [5.0, 6.0, 1.0])
    assert len(up_to_9.times_s) == 1


def test_annotations_are_keypoints_except_in_evaluation_frames(scene):
    dataset = video(scene, scale=0.5, keypoints="annotations.csv", occluded_weight=0.2)
    keypoints = {frame.index: frame.views[0].keypoints for frame in dataset.frames()}
    assert [index for index, rows in keypoints.items() if rows is not None] == [3, 10]
    assert keypoints[3][ANKLE] == pytest.approx([5.0, 19.75, 0.2])  # (u + ½) / 2 − ½
    assert np.isfinite(keypoints[10]).all(axis=1).sum() == 1
    assert all(frame.truth is None for frame in dataset.frames())
    dataset = video(scene, keypoints="annotations.csv", eval_annotations="annotations.csv", eval_frames=[10])
    frames = list(dataset.frames())
    assert [frame.index for frame in frames if frame.views[0].keypoints is not None] == [3]
    assert [frame.index for frame in frames if frame.truth is not None] == [10]


@pytest.mark.parametrize("scale", [0.5, 0.4, 0.73])
def test_image_camera_and_annotations_are_scaled_consistently(scene, scale):
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    blob = np.exp(-((x - 40.0) ** 2 + (y - 30.0) ** 2) / (2.0 * 4.0**2))
    cv2.imwrite(str(scene / "images" / "img_0.png"), np.repeat((250.0 * blob).astype(np.uint8)[..., None], 3, axis=2))
    (scene / "blob.csv").write_text("frame,joint,u,v,visible\n0,neck,40,30,1\n")
    dataset = video(scene, scale=scale, initial_annotations="blob.csv")
    view = next(dataset.frames()).views[0]
    assert view.image.shape == (view.camera.height, view.camera.width, 3)
    weights = view.image[..., 0].astype(float)
    rows, columns = np.mgrid[0 : view.camera.height, 0 : view.camera.width]
    centroid = [(weights * columns).sum() / weights.sum(), (weights * rows).sum() / weights.sum()]
    # Rounding to 8 bits shifts the centroid by hundredths of a pixel; a wrong pixel convention by up to half a pixel.
    neck = dataset.info.initial_annotations.keypoints[0, NECK, :2]
    assert neck == pytest.approx(centroid, abs=0.1)
    full = load_cameras(scene / "camera.toml")[0]
    point = full.rotation.T @ (np.array([(40 - 31.0) / 80.0, (30 - 23.0) / 80.0, 1.0]) * 4.0 - full.translation)
    assert view.camera.project(point) == pytest.approx(neck)


def test_a_video_file_is_decoded_in_order_with_its_rate(scene):
    path = scene / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (WIDTH, HEIGHT))
    for number in range(8):
        noise = np.random.default_rng(number).integers(-10, 11, (HEIGHT, WIDTH, 3))  # increases the size of the file
        writer.write((20 * number + 10 + noise).astype(np.uint8))
    writer.release()
    dataset = video(scene, source="video.avi", first_frame=2, rate_hz=None)
    frames = list(dataset.frames())
    assert dataset.info.rate_hz == 20.0
    assert [frame.index for frame in frames] == [2, 3, 4, 5, 6, 7]
    for frame in frames:  # JPEG changes grey levels by a few
        assert frame.views[0].image.mean() == pytest.approx(20 * frame.index + 10, abs=4)
    assert count_frames(path, at_most=3) == 3
    content, cut = path.read_bytes(), scene / "cut.avi"
    cut.write_bytes(content[: len(content) * 3 // 4])
    with pytest.warns(UserWarning, match="declares 8 frames"):
        assert 0 < count_frames(cut) < 8


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"source": "none.mp4"}, ["none.mp4", "no such"]),
        ({"source": "annotations.csv"}, ["annotations.csv", "expected a video"]),
        ({"source": "."}, ["expected images"]),
        ({"calibration_file": "none.toml"}, ["none.toml"]),
        ({"camera_name": "middle"}, ["middle", "left, right"]),
        ({"rate_hz": None}, ["rate_hz"]),
        ({"rate_hz": 0.0}, ["rate_hz", "0.0"]),
        ({"first_frame": 5, "n_frames": 8}, ["no frame 12", "0 to 11"]),
        ({"n_frames": 0}, ["n_frames", "0"]),
        ({"first_frame": -1}, ["-1"]),
        ({"scale": 0.0}, ["scale"]),
        ({"scale": 0.1}, ["scale", "6×5"]),
        ({"occluded_weight": 2.0}, ["occluded_weight"]),
        ({"initial_annotations": "annotations.csv"}, ["annotations in first_frame=0", "3, 10"]),
        (
            {"initial_annotations": "annotations.csv", "first_frame": 3, "initial_last_frame": 2},
            ["initial_last_frame", "first_frame=3", "found 2"],
        ),
        ({"keypoints": "annotations.csv", "eval_frames": [4]}, ["eval_frames", "found 4 without"]),
    ],
)
def test_the_error_of_an_invalid_option_names_it(scene, parameters, words):
    message = error_message(scene, **parameters)
    assert all(word in message for word in words)
    assert "\n" not in message


def test_images_of_another_size_and_unreadable_images_are_an_error(scene):
    cv2.imwrite(str(scene / "images" / "img_4.png"), np.zeros((HEIGHT, WIDTH + 2, 3), np.uint8))
    with pytest.raises(InputError, match="66×48, expected the 64×48 of camera 'left'"):
        list(video(scene).frames())
    (scene / "images" / "img_4.png").write_bytes(b"broken")
    with pytest.raises(InputError, match="img_4"):
        list(video(scene).frames())
    (scene / "images" / "img_4.png").unlink()
    _ = (dataset := video(scene)).info
    (scene / "images" / "img_11.png").unlink()
    with pytest.raises(InputError, match="ends before frame 10"):
        list(dataset.frames())


def write_video(path):
    """Write a small video under a file name that FFmpeg would take for an address."""
    writer = cv2.VideoWriter(str(path.parent / "clip.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    for number in range(3):
        writer.write(numbered_image(40 * number))
    writer.release()
    (path.parent / "clip.avi").rename(path)


@pytest.mark.parametrize("scheme", ["http", "tcp", "rtsp", "ftp", "rtmp", "udp", "https", "concat", "subfile", "file"])
def test_a_file_named_like_an_address_is_read_as_a_file(tmp_path, monkeypatch, scheme):
    """FFmpeg would connect to the address."""
    monkeypatch.chdir(tmp_path)
    folder = Path(f"{scheme}:") / "127.0.0.1:9"
    folder.mkdir(parents=True)
    write_video(tmp_path / folder / "a.avi")
    assert len(list(decode(folder / "a.avi"))) == 3
    assert count_frames(folder / "a.avi") == 3
    assert "OPENCV_FFMPEG_CAPTURE_OPTIONS" not in os.environ
    (folder / "b.avi").write_text("nothing")
    with pytest.raises(InputError, match="expected a video"):
        list(decode(folder / "b.avi"))


DECODE = """
import os, sys
from pathlib import Path
from workbench.utils.decode import count_frames
for path in sys.argv[1:]:
    try:
        print(count_frames(Path(path)) > 0)
    except Exception as error:
        print(type(error).__name__)
assert not {"OPENCV_FFMPEG_LOGLEVEL", "OPENCV_FFMPEG_CAPTURE_OPTIONS"} & set(os.environ)
"""


def test_ffmpeg_writes_no_messages(tmp_path):
    """Use a new process, since the first video sets the level of FFmpeg's messages."""
    writer = cv2.VideoWriter(str(tmp_path / "a.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 48))
    for number in range(20):
        writer.write(np.random.default_rng(number).integers(0, 255, (48, 64, 3), np.uint8))
    writer.release()
    video = (tmp_path / "a.mp4").read_bytes()
    damaged = bytearray(video)
    damaged[len(video) // 3 : len(video) // 2] = bytes(len(video) // 2 - len(video) // 3)
    contents = {"cut": video[: len(video) // 2], "damaged": damaged, "text": b"hello" * 1000}
    for name, content in contents.items():
        (tmp_path / f"{name}.mp4").write_bytes(content)
    command = [sys.executable, "-W", "ignore", "-c", DECODE, *(str(tmp_path / f"{name}.mp4") for name in contents)]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (process.stdout.split(), process.stderr) == (["InputError", "True", "InputError"], "")


PLAYLISTS = {
    "a.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\nclip.avi\n#EXT-X-ENDLIST\n",
    "a.txt": "ffconcat version 1.0\nfile clip.avi\n",
    "a.avi": "ffconcat version 1.0\nfile clip.avi\n",
    "a.sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 26\n",
    "a.mpd": '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><Period><AdaptationSet>'
    '<Representation id="1" bandwidth="1"><BaseURL>clip.avi</BaseURL></Representation></AdaptationSet></Period></MPD>',
}


@pytest.mark.parametrize("name", PLAYLISTS)
def test_a_playlist_is_not_a_video(tmp_path, name):
    write_video(tmp_path / "clip.avi")
    (tmp_path / name).write_text(PLAYLISTS[name])
    with pytest.raises(InputError, match="expected a video"):
        list(decode(tmp_path / name))


def test_a_file_named_like_a_pattern_does_not_open_other_images(tmp_path):
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"a_{k}.png"), numbered_image(40))
    (tmp_path / "a_%d.png").write_text("nothing")
    with pytest.raises(InputError, match="cannot be read"):
        list(decode(tmp_path / "a_%d.png"))


def test_a_named_pipe_is_an_error(tmp_path):
    os.mkfifo(tmp_path / "a.avi")
    with pytest.raises(InputError, match="no such video"):
        count_frames(tmp_path / "a.avi")
    (tmp_path / "images").mkdir()
    os.mkfifo(tmp_path / "images" / "a.png")
    with pytest.raises(InputError, match=r"a\.png: expected a file, found none"):
        list(decode(tmp_path / "images"))


def test_an_image_of_a_billion_pixels_is_rejected_before_it_is_decoded(tmp_path):
    size = struct.pack(">IIBBBBB", 32768, 32767, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + size
    content = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png: expected an image"):
        list(decode(tmp_path))


def test_chosen_images_of_a_video_and_of_a_folder_are_decoded(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (32, 24))
    (tmp_path / "images").mkdir()
    for k in range(6):
        image = np.full((24, 32, 3), 40 * k, np.uint8)
        writer.write(image)
        cv2.imwrite(str(tmp_path / "images" / f"{k}.png"), image)
    writer.release()
    for source in (tmp_path / "a.avi", tmp_path / "images"):
        levels = [image.mean() / 40.0 for image in decode(source, 1, 4, {0, 2, 4, 5})]
        assert np.round(levels).tolist() == [2.0, 4.0]


@pytest.fixture(scope="module")
def panned(tmp_path_factory):
    """A folder of images of a wall, seen by a level camera 1.4 m above the floor that pans by 24° after a person who
    walks 4 to 6 m away, with head and ankles annotated; and the camera's file."""
    folder, rng, n = tmp_path_factory.mktemp("panned"), np.random.default_rng(0), 25
    (folder / "images").mkdir()
    noise = cv2.GaussianBlur(rng.normal(size=(500, 1400)), (0, 0), 2.5)
    wall = np.clip(128.0 + 40.0 * noise / noise.std(), 0, 255).astype(np.uint8)
    matrix = np.array([[480.0, 0.0, 239.5], [0.0, 480.0, 134.5], [0.0, 0.0, 1.0]])
    centred, lines = np.array([[1.0, 0.0, -460.0], [0.0, 1.0, -115.0], [0.0, 0.0, 1.0]]), ["frame,joint,u,v,visible"]
    for t, angle in enumerate(np.radians(np.linspace(-12.0, 12.0, n))):
        turn = cv2.Rodrigues(np.array([0.0, -angle, 0.0]))[0]
        image = cv2.warpPerspective(wall, matrix @ turn @ np.linalg.inv(matrix) @ centred, (480, 270))
        cv2.imwrite(str(folder / "images" / f"{t:03d}.png"), image)
        depth = 5.0 + np.sin(0.5 * t)
        for joint, height in (
            ("head_centre", HEAD_HEIGHT),
            ("left_ankle", ANKLE_HEIGHT),
            ("right_ankle", ANKLE_HEIGHT),
        ):
            u, v, w = matrix @ turn @ [depth * np.tan(angle), 1.4 - 1.7 * height, depth]
            lines.append(f"{t},{joint},{u / w:.3f},{v / w:.3f},1")
    (folder / "annotations.csv").write_text("\n".join(lines) + "\n")
    text = CAMERA.format(name="left", width=480, height=270).replace("80.0", "480.0")
    (folder / "camera.toml").write_text(text.replace("31.0", "239.5").replace("23.0", "134.5"))
    return folder


def _pan_deg(camera, later):
    return np.degrees(np.arccos(np.clip(camera.rotation[2] @ later.rotation[2], -1.0, 1.0)))


@pytest.mark.parametrize("calibration_file", ["camera.toml", None])
def test_each_frame_of_a_camera_that_pans_has_its_camera(panned, calibration_file):
    file = None if calibration_file is None else str(panned / calibration_file)
    keypoints = str(panned / "annotations.csv")
    dataset = Video(str(panned / "images"), file, rate_hz=25.0, keypoints=keypoints, height_m=1.7)
    cameras = [frame.views[0].camera for frame in dataset.frames()]
    assert dataset.info.camera_motion == "turning"
    assert cameras[0].is_equal(dataset.source_camera)
    assert cameras[0].matrix[0, 0] == pytest.approx(480.0, rel=0.1)
    assert _pan_deg(cameras[0], cameras[-1]) == pytest.approx(24.0, rel=0.1)
    np.testing.assert_allclose([camera.position for camera in cameras], [cameras[0].position] * 25, atol=1e-9)
    assert calibration_file or cameras[0].position[2] == pytest.approx(1.4, abs=0.05)


def test_without_keypoints_the_motion_of_the_camera_is_not_measured(panned):
    assert Video(str(panned / "images"), str(panned / "camera.toml"), rate_hz=25.0).info.camera_motion is None


def test_image_files_are_in_the_order_of_their_times(tmp_path):
    names = [f"{7.0 + k / 32.0}.png" for k in range(32)]
    for name in names:
        (tmp_path / name).touch()
    assert [file.name for file in image_files(tmp_path)] == names
