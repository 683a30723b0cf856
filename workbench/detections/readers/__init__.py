"""Readers of joints that other detectors found: their formats, the layouts of their points, the pairing with images."""
