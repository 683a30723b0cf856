"""Recordings of runs and studies as Rerun files; the only package that writes them."""
