"""What every inference offers."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame
from workbench.inference.step import Step


class Inference(Protocol):
    """Turns frames into steps."""

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, from the pose `start` (P,) in the first; draws come from the named generators."""
