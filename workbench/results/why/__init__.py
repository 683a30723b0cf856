"""Causes of a lost track."""
