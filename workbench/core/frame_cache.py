"""Cache of a run's decoded frames."""

import logging
from collections.abc import Iterable, Iterator
from itertools import islice

from workbench.core.dataset import Dataset, SeparateImages
from workbench.core.frame import Frame

log = logging.getLogger(__name__)

MAX_BYTES = 500_000_000
"""Memory for cached images; later frames of a longer sequence are decoded again for every iteration."""


class FrameCache:
    """The frames of a dataset for any number of iterations, also concurrent ones.

    Decoded frames are cached until their images take `max_bytes`. The first iteration beyond them continues the
    decoding. Every later one opens the dataset again, which is logged once.
    """

    def __init__(self, dataset: Dataset, max_bytes: int = MAX_BYTES) -> None:
        """Read the metadata; raises InputError as `dataset.info` does."""
        self.info = dataset.info
        self.dataset, self._free_bytes = dataset, max_bytes
        self._cached: list[Frame] = []
        self._source: Iterator[Frame] | None = None  # positioned after the cached frames; None before and beyond them
        self._complete = self._logged = False

    def __len__(self) -> int:
        return self.info.n_frames

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while index < len(self._cached) or self._cache_next():
            yield self._cached[index]
            index += 1
        if not self._complete:
            yield from self._uncached()

    @property
    def without_images(self) -> Iterator[Frame]:
        """The frames with empty images, which are decoded only if the dataset cannot do without."""
        if isinstance(self.dataset, SeparateImages):
            return self.dataset.frames_without_images()
        return (frame.without_images for frame in self)

    def _cache_next(self) -> bool:
        """Decode and cache the next frame; return False at the end of the sequence and of the memory."""
        if self._complete or self._free_bytes <= 0:
            return False
        source = iter(self.dataset.frames()) if self._source is None else self._source
        # if decoding fails, the next iteration raises the same error
        self._source, free_bytes, self._free_bytes = None, self._free_bytes, 0
        frame = next(source, None)
        self._source, self._free_bytes = source, free_bytes
        if frame is None:
            self._complete = True
            return False
        self._cached.append(frame)
        self._free_bytes -= sum(view.image.nbytes for view in frame.views)
        return True

    def _uncached(self) -> Iterator[Frame]:
        """Return the frames after the cached ones."""
        source, self._source = self._source, None
        if source is not None:
            return source
        if not self._logged:
            log.info("%s: frames after the first %d are decoded again", self.info.name, len(self._cached))
            self._logged = True
        return islice(self.dataset.frames(), len(self._cached), None)


def without_images(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Yield frames with empty images, those of a cache without decoding them if possible."""
    return frames.without_images if isinstance(frames, FrameCache) else (frame.without_images for frame in frames)
