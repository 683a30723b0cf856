"""Readers of calibrations and points."""
