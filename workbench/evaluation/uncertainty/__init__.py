"""Calibration of posteriors: coverage, proper scores, expected errors; intervals of means."""
