"""Runs written as Rerun recordings; the only package that imports rerun."""
