"""Errors, uncertainty and verdict of a run, and the table of all metrics."""
