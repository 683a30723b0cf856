"""Errors of estimated poses and joints, offsets of markers, and the loss of a track."""
