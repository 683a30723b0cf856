"""The frames of one run, decoded once however many parts look at them."""

import logging
from collections.abc import Iterator
from itertools import islice

from workbench.core.dataset import Dataset
from workbench.core.frame import Frame

log = logging.getLogger(__name__)

MOST_BYTES = 2_000_000_000
"""Of images that are kept; a longer clip is decoded again from there on by whoever goes beyond."""


class FrameCache:
    """The frames of a dataset, which may be gone through any number of times, also at once.

    What has been decoded is kept until its images take `most_bytes`. Who goes beyond first goes on where the decoding
    has got to; who does so later opens the dataset again, and a sentence in the log says so once. Raises InputError, at
    once, for what the dataset refuses to know.
    """

    def __init__(self, dataset: Dataset, most_bytes: int = MOST_BYTES) -> None:
        self.info = dataset.info
        self.dataset, self._room = dataset, most_bytes
        self._kept: list[Frame] = []
        self._source: Iterator[Frame] | None = None  # stands after the frames kept; None before the first and beyond
        self._complete = self._told = False

    def __len__(self) -> int:
        return self.info.n_frames

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while index < len(self._kept) or self._keep_one():
            yield self._kept[index]
            index += 1
        if not self._complete:
            yield from self._beyond()

    def _keep_one(self) -> bool:
        """Decode and keep one more frame; False where there is none, or no room for it."""
        if self._complete or self._room <= 0:
            return False
        source = iter(self.dataset.frames()) if self._source is None else self._source
        self._source, room, self._room = None, self._room, 0  # if decoding fails, who comes next meets the failure too
        frame = next(source, None)
        self._source, self._room = source, room
        if frame is None:
            self._complete = True
            return False
        self._kept.append(frame)
        self._room -= sum(view.image.nbytes for view in frame.views)
        return True

    def _beyond(self) -> Iterator[Frame]:
        """Return the frames after those kept."""
        source, self._source = self._source, None
        if source is not None:
            return source
        if not self._told:
            log.info("%s: frames beyond the first %d are decoded again", self.info.name, len(self._kept))
            self._told = True
        return islice(self.dataset.frames(), len(self._kept), None)
