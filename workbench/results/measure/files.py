"""Files of measures: measures.csv, angles.csv and measures.html."""

from pathlib import Path

import numpy as np
import pandas as pd

from workbench.results.measure.measures import Curve, Measures
from workbench.results.measure.page import page
from workbench.utils.atomic_write import write_files

MEASURES, ANGLES, PAGE = "measures.csv", "angles.csv", "measures.html"
_DIGITS, _ANGLE_DIGITS = 6, 3


def write_measures(folder: Path, name: str, measures: Measures) -> list[Path]:
    """Write the files of the measures of a run of this name into a folder, see `write_files`.

    measures.csv: a row for each measure and side, with estimate and 90 % interval, empty where unknown. angles.csv: a
    row for each point of each curve, degrees, over percent of the cycle, with the strides, or over seconds.
    """
    texts = {
        MEASURES: measures.table.round(_DIGITS).to_csv(index=False),
        ANGLES: angle_table(measures).round(_ANGLE_DIGITS).to_csv(index=False),
        PAGE: page(f"Measures of {name}", measures),
    }
    return write_files(folder, texts)


def angle_table(measures: Measures) -> pd.DataFrame:
    """Return the curves as one table: angle, side, percent or time_s, mean_deg, low_90_deg, high_90_deg, and a column
    for each stride."""
    n_strides = max((len(curve.strides) for curve in measures.curves), default=0)
    x_name = "time_s" if measures.kind == "motion" else "percent"
    return pd.concat([_rows(curve, x_name, n_strides) for curve in measures.curves], ignore_index=True)


def _rows(curve: Curve, x_name: str, n_strides: int) -> pd.DataFrame:
    strides = np.full((n_strides, len(curve.x)), np.nan)
    strides[: len(curve.strides)] = curve.strides
    columns = {"angle": curve.name, "side": curve.side, x_name: curve.x, "mean_deg": curve.mean}
    columns |= {"low_90_deg": curve.low, "high_90_deg": curve.high}
    return pd.DataFrame(columns | {f"stride_{k + 1}_deg": stride for k, stride in enumerate(strides)})
