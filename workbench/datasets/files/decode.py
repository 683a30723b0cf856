"""Images out of a video file or a folder, one after the other."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from workbench.arrays import ByteArray
from workbench.datasets.files import natural_order
from workbench.errors import InputError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm")


def decode(source: Path, first: int = 0, last: int | None = None) -> Iterator[ByteArray]:
    """The images (height, width, 3), RGB, from number `first` to `last` (included; None: to the end), counted from 0. A
    video is decoded from its start, since seeking in one lands on other frames. It stops early where the source does.
    Raises InputError for a source that is missing or unreadable, and for an unreadable image in a folder."""
    if source.is_dir():
        files = image_files(source)
        for file in files[first : None if last is None else last + 1]:
            image = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if image is None:
                raise InputError(f"{file}: expected an image, found a file that cannot be read as one")
            yield _rgb(image)
        return
    with _opened(source) as video:
        index = 0
        while (last is None or index <= last) and video.grab():
            if index >= first:
                decoded, image = video.retrieve()
                if not decoded:
                    raise InputError(f"{source}: frame {index} cannot be decoded")
                yield _rgb(image)
            index += 1


def count_frames(source: Path, at_most: int | None = None) -> int:
    """Count the images that can be decoded, up to `at_most`, by decoding them; warns where a video file announces more
    than it holds, raises InputError as `decode` does."""
    if source.is_dir():
        return len(image_files(source))
    n = 0
    with _opened(source) as video, tqdm(desc=f"counting frames of {source.name}", unit="frame", disable=None) as bar:
        announced = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
        while (at_most is None or n < at_most) and video.grab():
            n += 1
            bar.update()
    if n < announced and (at_most is None or n < at_most):
        warnings.warn(f"{source}: announces {announced} frames, but only {n} can be decoded", stacklevel=2)
    return n


def frame_rate(source: Path) -> float | None:
    """Frames per second as a video file states it; None where it does not, and for a folder."""
    if source.is_dir():
        return None
    with _opened(source) as video:
        rate = float(video.get(cv2.CAP_PROP_FPS))
    return rate if np.isfinite(rate) and rate > 0.0 else None


def image_files(folder: Path) -> list[Path]:
    """The images of a folder in natural order: frame_9 before frame_10. Raises InputError where there are none."""
    files = [file.name for file in folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
    if not files:
        raise InputError(f"{folder}: expected images ({', '.join(IMAGE_SUFFIXES)}), found none")
    return [folder / name for name in natural_order(files)]


@contextmanager
def _opened(source: Path) -> Iterator[Any]:
    if not source.is_file():
        raise InputError(f"{source}: no such video file or folder of images")
    video = cv2.VideoCapture(str(source))
    try:
        if not video.isOpened():
            raise InputError(f"{source}: expected a video, found a file that cannot be read as one")
        yield video
    finally:
        video.release()


def _rgb(image: Any) -> ByteArray:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
