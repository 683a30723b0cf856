"""Tables of the experiments on single real subjects."""

from collections.abc import Mapping

import numpy as np

from analysis.figures.cached_runs import Run
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import Result
from analysis.tables.table import RUNS, TRACKED, Column, Labels, Table, between_seeds, mean
from analysis.tables.video import CAMERAS

SETTINGS = {
    ("`walk_video_multi_cue`", "the woman, 390 px tall"): ("walk_video_multi_cue", (), 5),
    ("`video_cues`", "the woman"): ("video_cues", (), 5),
    ("`balance_4cam`", "a residual: the truth is triangulated from the same detections"): ("balance_4cam", (), 1),
    **{
        (f"`balance_1cam`, `prior={prior}`", camera): (
            "balance_1cam", (f"prior={prior}", f"dataset.cameras=[{camera}]"), 1,
        )
        for prior in ("linear", "smooth") for camera in CAMERAS
    },
}  # fmt: skip
"""Experiment, overrides and number of seeds by the first cells of a row."""
ARM = {
    ("constant velocity",): ("balance_arm", (), 3),
    ("implicit",): ("balance_arm", ("prior=fitted_rest_implicit",), 3),
}
Settings = Mapping[Labels, tuple[str, tuple[str, ...], int]]


def table(labels: Labels, settings: Settings, columns: list[Column]) -> Table:
    """Return the table of settings over their seeds."""

    def rows(source: Source, n_seeds: int | None) -> dict[Labels, list[Run]]:
        return {
            cells: [
                Run(cells[0], experiment, "", seed, (f"paths.data={source.data}", *overrides))
                for seed in range(min(n, n_seeds or n))
            ]
            for cells, (experiment, overrides, n) in settings.items()
        }

    return Table(labels, rows, columns)


def of_seed(seed: int) -> Column:
    """Return the column of the error in space of one seed."""

    def value(results: Mapping[Run, Result]) -> float:
        return next((each.metrics["mpjpe_abs_mm"] for run, each in results.items() if run.seed == seed), np.nan)

    return Column(f"seed {seed}", value)


_ERRORS = [mean("mpjpe_px", 1), between_seeds("mpjpe_px", 1), mean("mpjpe_abs_mm"), mean("mpjpe_mm"), RUNS]
REAL_TABLES = {
    "real_subjects": table(("experiment", "setting"), SETTINGS, _ERRORS),
    "balance_arm": table(("prior",), ARM, [*map(of_seed, range(3)), TRACKED]),
}
