"""Recordings of studies: figures, drawn and as numbers."""
