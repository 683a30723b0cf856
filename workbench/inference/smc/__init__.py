"""Sequential Monte Carlo: the particle filter, its moves, smoothing."""
