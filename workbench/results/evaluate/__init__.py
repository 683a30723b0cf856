"""Evaluation of motions that any program made against true ones: files, scores, intervals, tables."""
