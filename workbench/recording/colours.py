"""One palette for all views. Orange estimate and blue truth stay apart for every kind of colour vision (RGB, 0–255)."""

ESTIMATE = (255, 159, 28)
BODY = (214, 160, 112)
TRUTH = (64, 196, 255)
TRUTH_HIDDEN = (38, 104, 138)
MODEL = (235, 235, 235)
TRAIL = (120, 120, 120)
LIGHTEST_PARTICLE = (66, 28, 80)
HEAVIEST_PARTICLE = (196, 140, 110)
