"""Temporal priors p(state_t | state_t−1)."""
