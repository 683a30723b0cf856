"""Single frames of a video, in any order, as JPEG."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

import cv2

from workbench.arrays import ByteArray
from workbench.datasets.files.decode import count_frames, decode
from workbench.errors import InputError

KEPT = 200
"""Frames that are kept once they were asked for or passed."""
QUALITY = 95


@dataclass
class Frames:
    """Frames of a video file, or of a folder of images. Seeking in a video lands on other frames, so that one is
    decoded from the last one asked for on or, for an earlier one that is not kept, from its start."""

    source: Path
    n_frames: int = field(init=False)
    size: tuple[int, int] = field(init=False)
    _images: Iterator[ByteArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Count the frames; raises InputError for a source without any."""
        self.n_frames = count_frames(self.source)
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._lock, self._images, self._next = Lock(), decode(self.source), 0
        first = next(self._images, None)
        if first is None:
            raise InputError(f"{self.source}: expected frames, found none that can be decoded")
        self.size = first.shape[1], first.shape[0]
        self._keep(first)

    def jpeg(self, number: int) -> bytes:
        """Return a frame as JPEG; raises InputError for a number that there is not."""
        if not 0 <= number < self.n_frames:
            raise InputError(f"no frame {number}, expected one of 0 to {self.n_frames - 1}")
        with self._lock:
            if number not in self._kept and number < self._next:
                self._images, self._next = decode(self.source), 0
            while number not in self._kept:
                image = next(self._images, None)
                if image is None:
                    raise InputError(f"{self.source}: frame {number} cannot be decoded")
                if number - self._next < KEPT // 4:
                    self._keep(image)
                else:
                    self._next += 1
            self._kept.move_to_end(number)
            return self._kept[number]

    def _keep(self, image: ByteArray) -> None:
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        self._kept[self._next] = encoded.tobytes()
        self._next += 1
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
