"""Motions: files, retargeting, the library and the models learned from it."""
