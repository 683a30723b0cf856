"""Comparison of two motions of named joints, made by any programs: common times, alignment, errors."""
