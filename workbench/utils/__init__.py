"""Utilities: arrays, errors, random streams, files and processes."""
