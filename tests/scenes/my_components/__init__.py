"""A user's own prior, likelihood and dataset."""
