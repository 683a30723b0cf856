"""Deterministic fits of poses and motions by least squares."""
