"""Writing a run's recording."""
