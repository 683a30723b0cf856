"""How far the estimate is from what each camera's keypoints show, which is all that tells where there is no truth."""

import numpy as np
import rerun as rr

from workbench.evaluation.evidence import RunMeasurements
from workbench.evaluation.verdict import FOREARM
from workbench.recording.write import colours
from workbench.utils.arrays import FloatArray

RESIDUALS = "residual_px"
LOST = "forearm"


def residuals(measured: RunMeasurements) -> dict[str, FloatArray]:
    """Return by camera (F,), px, NaN where it has none, and a forearm's width in the image; {} where none is known."""
    known = [v for v in range(len(measured.cameras)) if np.isfinite(measured.off_px[:, v]).any()]
    if not known:
        return {}
    heights = np.where(measured.height_px > 0.0, measured.height_px, np.nan)[:, known]
    counts = np.isfinite(heights).sum(axis=1)
    mean = np.where(counts > 0, np.nansum(heights, axis=1) / np.maximum(counts, 1), np.nan)
    return {measured.cameras[v]: measured.off_px[:, v] for v in known} | {LOST: FOREARM * mean}


def log_residuals(stream: rr.RecordingStream, measured: RunMeasurements) -> dict[str, tuple[float, float]]:
    """Log the residuals over frames and times, as marks where fewer than half of the frames have any; returns the
    spans of their values by entity path."""
    spans = {}
    for k, (name, values) in enumerate(residuals(measured).items()):
        path, known = f"{RESIDUALS}/{name}", np.isfinite(values)
        if not known.any():
            continue
        colour = colours.MODEL if name == LOST else colours.SERIES[k % len(colours.SERIES)]
        label = "lost above this, a forearm's width" if name == LOST else name
        lines = rr.SeriesLines(colors=[colour], widths=[1.5], names=[label])
        marks = rr.SeriesPoints(colors=[colour], marker_sizes=[4.0], markers="circle", names=[label])
        stream.log(path, lines if known.mean() >= 0.5 else marks, static=True)
        indexes = [
            rr.TimeColumn("frame", sequence=measured.frames[known]),
            rr.TimeColumn("time", duration=np.rint(measured.times_s[known] * 1e9).astype("timedelta64[ns]")),
        ]
        stream.send_columns(path, indexes=indexes, columns=rr.Scalars.columns(scalars=values[known]))
        spans[path] = (float(values[known].min()), float(values[known].max()))
    return spans
