"""Writers of a run's recording."""
