"""Comparing recordings."""
