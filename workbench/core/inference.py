"""What every inference offers."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame
from workbench.inference.step import Step
from workbench.priors.state import StateSpace


class Inference(Protocol):
    """Turns frames into steps."""

    @property
    def space(self) -> StateSpace:
        """Names and units of the columns of its steps' particles."""

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, from the pose `start` (P,) in the first, which some can do without; draws come from the
        named generators.
        """
