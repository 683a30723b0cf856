"""Camera calibration by a checkerboard or by a person of known height, and checks of a calibration."""
