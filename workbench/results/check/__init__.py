"""Comparison of recordings and regression checks."""
