"""One palette for all views, seen on black and on white (RGB, 0–255).

Orange estimate and blue truth stay apart for every kind of colour vision.
"""

ESTIMATE = (255, 159, 28)
BODY = (214, 160, 112, 100)
"""With an alpha, so that skeletons within are seen."""
BAND = (186, 120, 60)
SKIN = (214, 190, 170, 110)
"""With an alpha, so that points and skeletons within the surface are seen."""
TRUTH = (48, 170, 240)
TRUTH_HIDDEN = (38, 104, 138)
KEYPOINT = (120, 255, 130)
MODEL = (136, 136, 136)
"""Thresholds, models and what numbers should be."""
TRAIL = (120, 120, 120)
LIGHTEST_PARTICLE = (112, 92, 128)
HEAVIEST_PARTICLE = (190, 96, 255)
"""Purple: faint ones are grey beside it, on black and on white."""
SERIES = (
    (0, 158, 115), (213, 94, 0), (60, 120, 216), (204, 121, 167), (166, 138, 30), (128, 128, 128), (140, 86, 75),
)  # fmt: skip
"""Curves that share a plot, after Okabe & Ito without their yellow and sky blue, which white swallows."""
PARTS = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (190, 170, 20), (0, 114, 178), (213, 94, 0), (204, 121, 167),
    (120, 170, 205), (140, 190, 100), (240, 130, 130), (160, 130, 200), (176, 160, 90),
)  # fmt: skip
"""Body parts of observed points, after Okabe & Ito and ColorBrewer's paired colours."""
NO_PART = (110, 110, 110)
