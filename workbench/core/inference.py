"""What every inference offers."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

import numpy as np

from workbench.arrays import FloatArray
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace
from workbench.core.step import Step


class Inference(Protocol):
    """Turns frames into steps."""

    @property
    def space(self) -> StateSpace:
        """Names and units of the columns of its steps' particles."""

    @property
    def finds_start(self) -> bool:
        """Tell whether it finds the first pose itself where nobody gives one."""

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, from the pose `start` (P,) in the first, which some can do without; draws come from the
        named generators.
        """
