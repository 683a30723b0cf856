"""Recorded runs as data: found, filtered, compared, made smaller."""
