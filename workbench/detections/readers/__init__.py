"""Readers of the joints of other detectors: their formats, the layouts of their points, the pairing with images."""
