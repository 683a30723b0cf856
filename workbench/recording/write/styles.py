"""Colours (RGB, 0–255) for black and white backgrounds, and the styles of curves.

Orange estimate and blue truth differ for every kind of colour vision.
"""

from collections.abc import Iterable, Sequence
from itertools import cycle

import rerun as rr

from workbench.evaluation.metrics import CALIBRATED, row_of
from workbench.recording.write.columns import Entities

ESTIMATE, INTERVAL, TRUTH, TRUTH_HIDDEN = (255, 159, 28), (186, 120, 60), (48, 170, 240), (38, 104, 138)
BODY, SKIN = (214, 160, 112, 100), (214, 190, 170, 110)
"""Transparent, so that points and skeletons inside are visible."""
KEYPOINT, RIGHT_HAND, TRAIL, NO_PART = (120, 255, 130), (60, 180, 90), (120, 120, 120), (110, 110, 110)
MODEL = (136, 136, 136)
"""Thresholds, models and reference values."""
LIGHTEST_PARTICLE, HEAVIEST_PARTICLE = (112, 92, 128), (190, 96, 255)
"""Purple, and a greyish purple for small weights."""
SERIES = (
    (0, 158, 115), (213, 94, 0), (60, 120, 216), (204, 121, 167), (166, 138, 30), (128, 128, 128), (140, 86, 75),
)  # fmt: skip
"""Curves that share a plot, after Okabe & Ito without yellow and sky blue, which are faint on white."""
PARTS = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (190, 170, 20), (0, 114, 178), (213, 94, 0), (204, 121, 167),
    (120, 170, 205), (140, 190, 100), (240, 130, 130), (160, 130, 200), (176, 160, 90),
)  # fmt: skip
"""Body parts of observed points, after Okabe & Ito and ColorBrewer's paired colours."""

GROUPS = dict(zip(("head", "arms", "legs", "root"), SERIES, strict=False))
"""Colours of the curves of groups of joints: green, red, blue and pink."""
_THRESHOLD = MODEL, 1.5
_CURVES = {
    "mpjpe_abs_mm": (ESTIMATE, 2.5),
    "mpjpe_abs_mm_max_weight": (HEAVIEST_PARTICLE, 1.0),
    "mpjpe_mm": (SERIES[3], 1.0),
    "mpjpe_abs_marker_corrected_mm": (MODEL, 1.0),
    "pa_mpjpe_mm": (SERIES[0], 1.0),
    "mpjpe_px": (ESTIMATE, 2.5),
    "mpjpe_px_max_weight": (HEAVIEST_PARTICLE, 1.0),
    "forearm_width_px": _THRESHOLD,
    **{f"expected_error_{group}_mm": (colour, 2.5) for group, colour in GROUPS.items()},
    **{f"mpjpe_abs_{group}_mm": (colour, 2.0) for group, colour in GROUPS.items()},
}
"""Colour and width of the curves of metrics that share a plot."""
FOREARM = (row_of("forearm_width_px").label, *_THRESHOLD)
"""Style of a forearm's width in the image."""


def title(name: str, unit: str = "") -> str:
    """Return a parameter's name as words, with its unit."""
    words = name.replace("_", " ")
    unit = "degrees" if unit == "rad" else unit  # angles are drawn in degrees
    return f"{words} ({unit})" if unit not in ("", "1") else words


def line(label: str, colour: tuple[int, int, int], width: float) -> rr.SeriesLines:
    """Return the style of a curve."""
    return rr.SeriesLines(colors=[colour], widths=[width], names=[label])


def dots(label: str, colour: tuple[int, int, int], _width: float = 0.0) -> rr.SeriesPoints:
    """Return the style of a sparse curve: points without lines."""
    return rr.SeriesPoints(colors=[colour], markers="circle", marker_sizes=[4.0], names=[label])


def metric_style(name: str, metrics: Sequence[str]) -> tuple[str, tuple[int, int, int], float]:
    """Return label, colour and width of a metric's curve among all `metrics`; in a shared plot colours differ."""
    row = row_of(name)
    if not row.plot:
        return row.title, ESTIMATE, 2.0
    if name in _CURVES:
        return row.label, *_CURVES[name]
    used = {colour for each, (colour, _) in _CURVES.items() if row_of(each).plot == row.plot}
    others = [each for each in metrics if row_of(each).plot == row.plot and each not in _CURVES]
    colours = dict(zip(others, cycle(colour for colour in SERIES if colour not in used), strict=False))
    return row.label, colours[name], 2.0


def metric_lines(metrics: Sequence[str]) -> Entities:
    """Yield the styles of the curves of metrics, to be logged static."""
    for name in metrics:
        yield f"metrics/{name}", line(*metric_style(name, metrics))
        yield from ((path, line("calibrated", MODEL, 1.5)) for path in guides([name]))


def guides(metrics: Iterable[str]) -> dict[str, float]:
    """Return the reference values of metrics by entity path."""
    return {f"guides/{name}": CALIBRATED[name] for name in metrics if name in CALIBRATED}
