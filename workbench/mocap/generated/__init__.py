"""Invented people: walkers, runners and an arm, for work without recordings."""
