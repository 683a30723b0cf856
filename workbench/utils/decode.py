"""Sequential decoding of the images of a video file or a folder.

A source is an existing file or folder. It is opened by its absolute path and only as a media container: FFmpeg, which
OpenCV uses for videos, would interpret a name such as `http:/…` as an address, and open the files of a playlist.
"""

import os
import warnings
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from tqdm import tqdm

from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file, check_number
from workbench.utils.text import natural_order

_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm")
MAX_BYTES = 1 << 45
"""Size of a video or an image file, which is read in chunks."""
_MAX_DECLARED = 100_000_000
"""Frames of a day at 1000 Hz, which OpenCV reports as the rate of WebM files."""

_OPTIONS, _LOG_LEVEL = "OPENCV_FFMPEG_CAPTURE_OPTIONS", "OPENCV_FFMPEG_LOGLEVEL"
_QUIET = "-8"
"""FFmpeg's AV_LOG_QUIET."""
_CONTAINERS = (
    "asf,avi,dv,flv,gif,h264,hevc,ivf,m4v,matroska,webm,mjpeg,mov,mp4,m4a,3gp,3g2,mj2,mpeg,mpegts,mpegvideo,mxf,nut,ogg,"
    "wtv,yuv4mpegpipe"
)
"""FFmpeg's names of formats that contain images; the others are lists of other files, streams and devices."""


def decode(
    source: Path, first: int = 0, last: int | None = None, chosen: Container[int] | None = None
) -> Iterator[ByteArray]:
    """Yield images (height, width, 3), RGB, from number `first` to `last` (included; None: to the end), counted from 0.

    chosen : numbers of the images to yield; None: all.

    A video is decoded from its start, because seeking is inexact. The iteration ends early where the source does.
    Raises InputError for a source that is missing or unreadable, and for an unreadable image in a folder.
    """
    if _has_images(source):
        files = image_files(source)
        for index, file in enumerate(files[first : None if last is None else last + 1], first):
            if chosen is None or index in chosen:
                yield _rgb(_image(file))
        return
    with _opened(source) as video:
        index = 0
        while (last is None or index <= last) and video.grab():
            if index >= first and (chosen is None or index in chosen):
                yield _rgb(_retrieved(video, source, index))
            index += 1


def count_frames(source: Path, at_most: int | None = None) -> int:
    """Return the number of decodable images, up to `at_most`; warns and raises as `timestamps` does."""
    return len(image_files(source)) if _has_images(source) else len(timestamps(source, at_most))


def timestamps(
    source: Path, at_most: int | None = None, observe: Callable[[ByteArray], None] | None = None
) -> FloatArray:
    """Return the presentation timestamps (F,), s, of a video file's decodable frames, up to `at_most`.

    observe : called with every image (height, width, 3), BGR.

    Warns where the file declares more time than its frames last. Raises InputError as `decode` does, and where no frame
    can be decoded, with the codec.
    """
    times_s: list[float] = []
    start_s = 0.0
    with _opened(source) as video, tqdm(desc=f"counting frames of {source.name}", unit="frame", disable=None) as bar:
        header, codec = _header_of(video), int(video.get(cv2.CAP_PROP_FOURCC))
        declared, header_hz = _checked_frames(source, header), header.rate_hz
        while (at_most is None or len(times_s) < at_most) and video.grab():
            if not times_s and header_hz > 0.0:  # of Matroska, whose duration begins at 0; the times at the first frame
                start_s = max(0.0, float(video.get(cv2.CAP_PROP_PTS)) / header_hz)
            times_s.append(float(video.get(cv2.CAP_PROP_POS_MSEC)) / 1e3)
            if observe is not None:
                observe(_retrieved(video, source, len(times_s) - 1))
            bar.update()
    if not times_s:
        name = codec.to_bytes(4, "little", signed=codec < 0).decode("ascii", "replace").strip("\0 ") or "unknown"
        raise InputError(
            f"{source}: expected frames, found none that OpenCV can decode (codec {name}); convert it: "
            f"ffmpeg -i {source.name} -c:v libx264 -fps_mode passthrough {source.stem}_h264.mp4"
        )
    is_whole = at_most is None or len(times_s) < at_most
    n_lost = frames_lost(declared / header_hz - start_s, times_s, header_hz) if is_whole and header_hz > 0.0 else 0
    if n_lost:
        message = f"{source}: declares {len(times_s) + n_lost} frames, but only {len(times_s)} can be decoded"
        warnings.warn(message, stacklevel=2)
    return np.array(times_s)


def frames_lost(duration_s: float, times_s: Sequence[float], header_hz: float) -> int:
    """Return how many frames at the mean interval a declared duration has after the last of `times_s`, s."""
    span_s = times_s[-1] - times_s[0]
    interval_s = span_s / (len(times_s) - 1) if span_s > 0.0 else 1.0 / header_hz
    return max(0, round((duration_s - times_s[-1]) / interval_s) - 1)


def frame_rate(source: Path) -> float | None:
    """Return the frame rate of a video file, Hz; None without one, and for images."""
    if _has_images(source):
        return None
    rate = _header(source, file_version(source)).rate_hz
    return rate if np.isfinite(rate) and rate > 0.0 else None


def rotation_deg(source: Path) -> float:
    """Return the angle by which a video file's frames are turned to be upright, as `decode` does."""
    return _header(source, file_version(source)).rotation_deg


def declared_frames(source: Path) -> int:
    """Return the number of frames that a video file declares."""
    return _checked_frames(source, _header(source, file_version(source)))


def image_shape(source: Path) -> tuple[int, ...]:
    """Return the shape (height, width, 3) of the first image; raises InputError without one, and as `decode` does."""
    if (image := next(decode(source, 0, 0), None)) is None:
        raise InputError(f"{source}: expected at least one frame, found none")
    return image.shape


def file_version(source: Path) -> tuple[int, int] | None:
    """Return what changes with the content of a file: its time and size; None for a folder and a missing file."""
    if not source.is_file():
        return None
    file = source.stat()
    return file.st_mtime_ns, file.st_size


class _Header(NamedTuple):
    """Properties of a video file, as declared."""

    rate_hz: float
    rotation_deg: float
    n_frames: int


@lru_cache(maxsize=64)  # opening a video takes as long as decoding some of its images
def _header(source: Path, _version: object) -> _Header:
    with _opened(source) as video:
        return _header_of(video)


def _header_of(video: Any) -> _Header:
    rate_hz, rotation = float(video.get(cv2.CAP_PROP_FPS)), float(video.get(cv2.CAP_PROP_ORIENTATION_META))
    return _Header(rate_hz, rotation, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))


def _checked_frames(source: Path, header: _Header) -> int:
    """Return the number of frames in a video's header, or of its duration at the header's rate."""
    check_number(source, "frames in its header", header.n_frames, _MAX_DECLARED)
    return header.n_frames


def image_files(folder: Path) -> list[Path]:
    """Return the images of a folder in the order of their numbers or times, see `natural_order`, or a single image;
    raises InputError for none."""
    if folder.is_file():
        return [folder]
    files = [
        file.name
        for file in folder.iterdir()
        if file.suffix.lower() in _IMAGE_SUFFIXES and not file.name.startswith(".")
    ]
    if not files:
        raise InputError(f"{folder}: expected images ({', '.join(_IMAGE_SUFFIXES)}), found none")
    return [folder / name for name, _ in natural_order(files)]


def _has_images(source: Path) -> bool:
    """Return whether a source is a folder of images or a single image."""
    return source.is_dir() or (source.is_file() and source.suffix.lower() in _IMAGE_SUFFIXES)


@contextmanager
def _opened(source: Path) -> Iterator[Any]:
    if not source.is_file():
        raise InputError(f"{source}: no such video file or folder of images")
    check_file(source, MAX_BYTES)
    with _capture_settings():
        video = cv2.VideoCapture(os.path.abspath(source), cv2.CAP_FFMPEG)
    try:
        if not video.isOpened():
            raise InputError(f"{source}: expected a video, found a file that cannot be read as one")
        yield video
    finally:
        video.release()


@contextmanager
def _capture_settings() -> Iterator[None]:
    """Restrict FFmpeg to files in the formats _CONTAINERS, and silence its messages and OpenCV's, which precede ours.

    OpenCV has no function for these settings; it reads the environment, the log level when a process opens its first
    video. A level that the user set is unchanged.
    """
    own = {_OPTIONS: f"protocol_whitelist;file|format_whitelist;{_CONTAINERS}"}
    own |= {} if _LOG_LEVEL in os.environ else {_LOG_LEVEL: _QUIET}
    before, level = {name: os.environ.get(name) for name in own}, cv2.utils.logging.getLogLevel()
    os.environ.update(own)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _retrieved(video: Any, source: Path, index: int) -> ByteArray:
    """Return the image (height, width, 3), BGR, that a video has grabbed."""
    try:
        decoded, image = video.retrieve()
    except cv2.error:
        decoded, image = False, None
    if not decoded:
        raise InputError(f"{source}: frame {index} cannot be decoded")
    return np.asarray(image, dtype=np.uint8)


def _image(file: Path) -> Any:
    check_file(file, MAX_BYTES)
    try:
        image = cv2.imread(os.path.abspath(file), cv2.IMREAD_COLOR)
    except cv2.error:  # too many pixels for OpenCV, or damage that its decoders do not handle
        image = None
    if image is None:
        raise InputError(f"{file}: expected an image, found a file that cannot be read as one")
    return image


def _rgb(image: Any) -> ByteArray:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
