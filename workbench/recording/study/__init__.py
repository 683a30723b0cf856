"""Recordings of studies: figures as drawings and as numbers."""
