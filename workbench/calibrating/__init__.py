"""Cameras out of pictures of a checkerboard, or of a person whose height is known."""
