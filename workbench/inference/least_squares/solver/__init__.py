"""Numerics of least squares: sparse normal equations, residual functions, kernels, and the fit of one frame."""
