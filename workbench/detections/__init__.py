"""Detected and annotated joints: the detector, readers of files, association, synchronization, annotation by hand."""
