"""Cameras: projection, triangulation, files, calibration by a board or by a person, and checks of a calibration."""
