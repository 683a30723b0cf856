"""Measures of a recorded motion: tables, files and a page."""
