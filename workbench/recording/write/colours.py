"""One palette for all views. Orange estimate and blue truth stay apart for every kind of colour vision (RGB, 0–255)."""

ESTIMATE = (255, 159, 28)
BODY = (214, 160, 112, 100)
"""With an alpha, so that skeletons within are seen."""
BAND = (186, 120, 60)
SKIN = (214, 190, 170, 110)
"""With an alpha, so that points and skeletons within the surface are seen."""
PELVIS_ON_PELVIS = (255, 224, 150)
TRUTH = (64, 196, 255)
TRUTH_HIDDEN = (38, 104, 138)
KEYPOINT = (120, 255, 130)
MODEL = (235, 235, 235)
TRAIL = (120, 120, 120)
LIGHTEST_PARTICLE = (66, 28, 80)
HEAVIEST_PARTICLE = (196, 140, 110)
PARTS = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167),
    (166, 206, 227), (178, 223, 138), (251, 154, 153), (202, 178, 214), (255, 255, 153),
)  # fmt: skip
"""Body parts of observed points, after Okabe & Ito and ColorBrewer's paired colours."""
NO_PART = (110, 110, 110)
