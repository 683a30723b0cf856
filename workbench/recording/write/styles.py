"""Colours (RGB, 0–255) for black and white backgrounds, and the styles and titles of curves.

Orange estimate and blue truth differ for every kind of colour vision.
"""

from collections.abc import Iterable, Sequence
from itertools import cycle

import rerun as rr

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

GROUPS = {"head": ("green", SERIES[0]), "arms": ("red", SERIES[1]), "legs": ("blue", SERIES[2]),
          "root": ("pink", SERIES[3])}  # fmt: skip
"""Groups of joints with a curve of their expected error: name of the colour, and the colour."""
_ESTIMATE = ("expected pose", ESTIMATE, 2.5)
_MAX_WEIGHT = ("particle of largest weight", HEAVIEST_PARTICLE, 1.0)
FOREARM = ("threshold: a forearm's width", MODEL, 1.5)
_CURVES = {
    "mpjpe_abs_mm": _ESTIMATE,
    "mpjpe_abs_mm_max_weight": _MAX_WEIGHT,
    "mpjpe_mm": ("root-aligned", SERIES[3], 1.0),
    "mpjpe_abs_marker_corrected_mm": ("marker offsets corrected", MODEL, 1.0),
    "pa_mpjpe_mm": ("Procrustes-aligned", SERIES[0], 1.0),
    "mpjpe_px": _ESTIMATE,
    "mpjpe_px_max_weight": _MAX_WEIGHT,
    "forearm_width_px": FOREARM,
    **{f"expected_error_{group}_mm": (group, colour, 2.5) for group, (_, colour) in GROUPS.items()},
    **{f"mpjpe_abs_{group}_mm": (group, colour, 2.0) for group, (_, colour) in GROUPS.items()},
}
"""Metrics that share a plot: (name in the legend, colour, width)."""
_GUIDES = {"coverage_90": 0.9}
"""Reference values of metrics, drawn as lines."""
_TITLES = {
    "mpjpe_abs_mm": "absolute MPJPE (mm)",
    "mpjpe_mm": "MPJPE, root-aligned (mm)",
    "mpjpe_px": "2-D MPJPE (pixels)",
    "jump_deg": "largest change of a joint angle (degrees)",
    "same_activity": "samples from the initial activity (1: all)",
    "coverage_90": "coverage of 90 % intervals",
    "crps_mm": "CRPS, position (mm)",
    "crps_deg": "CRPS, angles (degrees)",
    "nll": "NLL per parameter (nats)",
    "ess": "effective sample size",
    "log_evidence": "log evidence of all frames so far",
    "knee_flexion_rmse_deg": "knee flexion RMSE (degrees)",
    "hip_flexion_rmse_deg": "hip flexion RMSE (degrees)",
    "humaneva_mm": "HumanEva error (mm)",
    "humaneva_px": "HumanEva error (pixels)",
    "pck_abs_150mm": "PCK at 150 mm",
    "mpjae_local_deg": "local MPJAE (degrees)",
    "acceleration_error_m_s2": "acceleration error (m/s²)",
    "unique_ancestors_lag10": "distinct ancestors 10 frames ago",
    "nees_per_dim": "NEES per dimension",
    "coverage_50": "coverage of 50 % intervals",
    **{f"coverage_90_{group}": f"{group}: coverage of 90 %" for group in GROUPS},
    "activity_accuracy": "activity accuracy (1: correct)",
}


def title(name: str, unit: str = "") -> str:
    """Return a metric's or parameter's name as words, with its unit."""
    words = _TITLES.get(name, name.replace("_", " "))
    unit = "degrees" if unit == "rad" else unit  # angles are drawn in degrees
    return f"{words} ({unit})" if unit not in ("", "1") else words


def line(label: str, colour: tuple[int, int, int], width: float) -> rr.SeriesLines:
    """Return the style of a curve."""
    return rr.SeriesLines(colors=[colour], widths=[width], names=[label])


def dots(label: str, colour: tuple[int, int, int], _width: float = 0.0) -> rr.SeriesPoints:
    """Return the style of a sparse curve: points without lines."""
    return rr.SeriesPoints(colors=[colour], markers="circle", marker_sizes=[4.0], names=[label])


def metric_style(name: str, metrics: Sequence[str]) -> tuple[str, tuple[int, int, int], float]:
    """Return label, colour and width of a metric's curve among all `metrics`."""
    cues = dict(zip(variance_fractions(metrics), cycle(SERIES)))
    if name in cues:
        return title(name), cues[name], 2.0
    return _CURVES.get(name, (title(name), ESTIMATE, 2.0))


def metric_lines(metrics: Sequence[str]) -> Entities:
    """Yield the styles of the curves of metrics, to be logged static."""
    for name in metrics:
        yield f"metrics/{name}", line(*metric_style(name, metrics))
        yield from ((path, line("calibrated", MODEL, 1.5)) for path in guides([name]))


def guides(metrics: Iterable[str]) -> dict[str, float]:
    """Return the reference values of metrics by entity path."""
    return {f"guides/{name}": _GUIDES[name] for name in metrics if name in _GUIDES}


def variance_fractions(metrics: Iterable[str]) -> list[str]:
    """Return those of the metrics that are variance fractions of cues."""
    return [name for name in metrics if name.startswith("variance_fraction_")]
