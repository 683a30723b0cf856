"""A prior, a likelihood and a dataset of a user's own."""
