"""Arrays, errors, random streams, files and processes."""
