"""Whether a calibration fits, told before anything is tracked."""
