"""Comparison of two motions of named joints, whoever made them: common times, alignment, errors."""
