"""Camera calibration by a checkerboard or by a person of known height, and a check whether a calibration fits."""
