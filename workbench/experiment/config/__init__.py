"""Configurations: their schema, what goes together, and from a configuration to objects."""
