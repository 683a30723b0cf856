"""Synthetic gait and arm motion."""
