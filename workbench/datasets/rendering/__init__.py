"""Rendered scenes: person, surroundings, camera and occluders."""
