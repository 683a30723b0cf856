"""Parts that datasets are made of: rendering, surroundings, points on a surface."""
