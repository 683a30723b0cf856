"""Measures of recorded motion: steps, spatio-temporal parameters, joint angles over the gait cycle, repetitions."""
