"""From motion libraries to learned models."""
