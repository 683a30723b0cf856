"""Times of frames from the timestamps of a file."""

import struct

import numpy as np
import pytest
from video_files import camera_table, video, with_durations

from workbench.datasets.video import Video
from workbench.utils.decode import declared_frames, frame_rate, frames_lost, image_shape, timestamps
from workbench.utils.errors import InputError
from workbench.utils.frame_times import FrameTimes, frame_times, given_times, is_equal, rate_in_file

N = 24
DURATIONS = [1.0] * 14 + [2.0] * 10
UNEVEN_S = np.concatenate([[0.0], np.cumsum(DURATIONS)[:-1]]) / 30.0


@pytest.mark.parametrize("rate_hz", [24.0, 29.97, 30.0, 59.94, 120.0])
def test_times_of_a_constant_rate_are_exactly_the_index_over_the_rate(tmp_path, rate_hz):
    path = video(tmp_path / "a.mp4", N, rate_hz)
    times = frame_times(path, timestamps(path))
    assert (times.rate_hz, times.uneven_s) == (rate_hz, None)
    assert times.at(np.arange(N)).tolist() == [k / rate_hz for k in range(N)]
    assert times.since(3, np.arange(N)).tolist() == [(k - 3) / rate_hz for k in range(N)]


def test_times_of_a_variable_rate_are_the_timestamps(tmp_path, caplog):
    path = with_durations(video(tmp_path / "a.mp4", N, 30.0), DURATIONS)
    (tmp_path / "calibration.toml").write_text(camera_table("cam", (160, 120), 200.0))
    assert timestamps(path, 5) == pytest.approx(UNEVEN_S[:5])
    dataset = Video(str(path), str(tmp_path / "calibration.toml"), first_frame=10)
    frames = list(dataset.frames())
    assert [frame.time_s for frame in frames] == pytest.approx(UNEVEN_S[10:], abs=1e-4)
    levels = [frame.views[0].image.mean() / 4 for frame in frames]
    assert (np.diff(levels) > 0.0).all()
    assert levels == pytest.approx(list(range(10, N)), abs=1.2)  # lossy compression
    assert dataset.info.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert "33.3 to 66.7 ms" in caplog.text
    constant_rate = Video(str(path), str(tmp_path / "calibration.toml"), rate_hz=30.0)
    assert [frame.time_s for frame in constant_rate.frames()] == [k / 30.0 for k in range(N)]


def test_rounded_timestamps_have_a_constant_rate_and_jittered_ones_do_not(tmp_path):
    path = video(tmp_path / "a.mp4", N, 30.0)
    exact = np.arange(N) / 30.0
    assert frame_times(path, np.floor(exact * 1e3) / 1e3).uneven_s is None  # as in Matroska files
    jittered = exact + np.random.default_rng(0).uniform(-0.005, 0.005, N)
    assert frame_times(path, jittered).uneven_s == pytest.approx(jittered - jittered[0])


def test_a_header_that_contradicts_the_timestamps_is_reported(tmp_path, caplog):
    path = video(tmp_path / "a.mp4", N, 1000.0)  # as OpenCV reports for WebM files of browsers
    times = frame_times(path, np.arange(N) / 25.0)
    assert (times.rate_hz, times.uneven_s) == (pytest.approx(25.0), None)
    assert "header's rate is 1000 Hz" in caplog.text
    caplog.clear()
    assert frame_times(path, np.array([0.0, 1.0, 0.5])).rate_hz == 1000.0
    assert "do not increase" in caplog.text


def test_times_are_extrapolated_at_the_rate():
    times = FrameTimes(10.0, np.array([0.0, 0.1, 0.3]))
    assert times.at(np.array([-1, 0, 2, 4])) == pytest.approx([-0.1, 0.0, 0.3, 0.5])
    assert times.since(1, np.array([1, 2])) == pytest.approx([0.0, 0.2])
    assert is_equal(times, FrameTimes(10.0, np.array([0.0, 0.1])))
    assert not is_equal(times, FrameTimes(10.0))
    assert not is_equal(FrameTimes(29.97), FrameTimes(30.0))


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_a_rate_out_of_range_is_rejected(rate_hz):
    with pytest.raises(InputError, match="rate_hz"):
        given_times(rate_hz)


def test_an_undecodable_video_is_an_error_with_its_codec_and_a_remedy(tmp_path):
    path = video(tmp_path / "a.mp4", N, 30.0)
    assert declared_frames(path) == N
    content = path.read_bytes()
    start = content.index(b"mp4v", content.index(b"stsd"))
    path.write_bytes((content[:start] + b"av01" + content[start + 4 :]).replace(b"esds", b"free"))
    with pytest.raises(InputError, match=r"codec .*ffmpeg -i a\.mp4 -c:v libx264"):
        timestamps(path)


@pytest.mark.parametrize(("jitter", "is_said"), [(0.45, False), (0.55, True)])
def test_a_rate_that_is_set_is_compared_with_the_timestamps(tmp_path, caplog, jitter, is_said):
    """The header's rate of a browser's WebM file is 1000 Hz. Times half a frame from a constant rate are uneven."""
    path = video(tmp_path / "a.mp4", N, 1000.0)
    times_s = np.arange(N) / 30.0
    assert rate_in_file(path, np.round(times_s, 3), 30.0) == 30.0
    assert rate_in_file(path, times_s, 25.0) == pytest.approx(30.0)
    assert not caplog.text
    times_s[5] += jitter / 30.0
    times_s[9] -= jitter / 30.0
    assert rate_in_file(path, times_s, 30.0) == pytest.approx(30.0)
    assert ("times are uneven" in caplog.text) == is_said
    assert rate_in_file(path, np.zeros(N), 30.0) == 1000.0
    assert rate_in_file(tmp_path, times_s, 30.0) is None


@pytest.mark.parametrize(("duration_s", "n_lost"), [(2.0, 0), (2.049, 0), (2.051, 1), (3.0, 10)])
def test_lost_frames_are_counted_by_the_declared_duration(duration_s, n_lost):
    assert frames_lost(duration_s, (np.arange(20) / 10.0).tolist(), 1000.0) == n_lost


def test_the_header_and_the_size_are_those_of_the_file_as_it_is_now(tmp_path):
    path = video(tmp_path / "a.mp4", N, 30.0)
    before = frame_rate(path), declared_frames(path), image_shape(path)
    video(path, N + 2, 25.0, size=(48, 32))
    assert (frame_rate(path), declared_frames(path), image_shape(path)) == (25.0, N + 2, (32, 48, 3)) != before


def test_a_header_with_billions_of_frames_is_rejected(tmp_path):
    path = video(tmp_path / "a.mp4", N, 30.0)
    content = path.read_bytes()
    place = content.index(b"stts") + 12
    for count, is_valid in ((99_000_000, True), (2**31 - 1, False)):
        path.write_bytes(content[:place] + struct.pack(">I", count) + content[place + 4 :])
        if is_valid:
            declared_frames(path)
        else:
            with pytest.raises(InputError, match=r"at most 100000000 frames in its header"):
                declared_frames(path)
