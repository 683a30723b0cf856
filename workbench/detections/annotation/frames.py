"""Random access to the frames of a video as JPEG."""

from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from threading import Lock

import cv2

from workbench.utils.arrays import ByteArray
from workbench.utils.decode import count_frames, decode
from workbench.utils.errors import InputError

_CACHED_FRAMES = 200
_JPEG_QUALITY = 95


class Frames:
    """Random access to the frames of a video file or a folder of images.

    Seeking in a video is inexact. A frame is therefore decoded by continuing from the last one or, for an earlier frame
    that is not cached, by starting again from frame 0.
    """

    def __init__(self, source: Path) -> None:
        """Count the frames; raises InputError for a source without frames."""
        self.source, self.n_frames = source, count_frames(source)
        self._cache: OrderedDict[int, bytes] = OrderedDict()
        self._lock, self._next = Lock(), 0
        self._images: Iterator[ByteArray] = decode(source)
        height, width, _ = next(decode(source, last=0)).shape
        self.size = width, height

    def jpeg(self, number: int) -> bytes:
        """Return a frame as JPEG; raises InputError for a number outside the video."""
        if not 0 <= number < self.n_frames:
            raise InputError(f"no frame {number}, expected one of 0 to {self.n_frames - 1}")
        with self._lock:
            if number not in self._cache and number < self._next:
                self._images, self._next = decode(self.source), 0
            while number not in self._cache:
                image = next(self._images, None)
                if image is None:
                    raise InputError(f"{self.source}: frame {number} cannot be decoded")
                if number - self._next < _CACHED_FRAMES // 4:
                    self._cache[self._next] = _encoded(image)
                self._next += 1
                while len(self._cache) > _CACHED_FRAMES:
                    self._cache.popitem(last=False)
            self._cache.move_to_end(number)
            return self._cache[number]


def _encoded(image: ByteArray) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
