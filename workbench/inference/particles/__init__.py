"""The particle filter, its moves, and what wraps it."""
