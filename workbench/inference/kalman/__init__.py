"""One Gaussian for each frame: a filter that climbs every frame's posterior, and a second pass over all frames."""
