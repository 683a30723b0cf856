"""Where the truth lies among the particles, over a whole run, as bars: even where the posterior is calibrated."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.core.step import Step
from workbench.evaluation.calibration import rank_histogram
from workbench.evaluation.step_calibration import pose_ranks
from workbench.recording.write import colours

Entities: TypeAlias = Iterator[tuple[str, rr.AsComponents]]

PATH = "evaluation/ranks"
_BINS = 10


class Ranks:
    """Counts the ranks of the true pose's numbers, frame by frame; not of the first frame, which is given."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self._began = False

    def add(self, step: Step) -> None:
        """Take one step in."""
        if self._began:
            self._counts += rank_histogram(pose_ranks(step), _BINS)
        self._began = True

    def pictures(self) -> Entities:
        """Shares of all ranks so far in each tenth, to be logged static, and before them even ones; without truth
        nothing."""
        if (total := self._counts.sum()) == 0:
            return
        left = np.arange(_BINS) / _BINS
        wide, thin = np.full(_BINS, 1.0 / _BINS), np.full(_BINS, 0.1 / _BINS)
        yield PATH, rr.BarChart(self._counts / total, abscissa=left, widths=wide, color=colours.ESTIMATE)
        even = rr.BarChart(wide, abscissa=left + 0.45 / _BINS, widths=thin, color=colours.MODEL)
        yield f"{PATH}/even", even


def view() -> rrb.BarChartView:
    """Its place in the layout."""
    name = "ranks of the truth (even: right, U: too sure)"
    return rrb.BarChartView(origin=f"/{PATH}", name=name, plot_legend=rrb.PlotLegend(visible=False))
