"""Errors and calibration of the posterior."""
