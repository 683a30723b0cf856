"""An iterated extended Kalman filter over poses, with a backward pass."""
