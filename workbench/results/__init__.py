"""Recorded runs as data."""
