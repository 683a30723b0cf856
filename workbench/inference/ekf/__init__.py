"""The iterated extended Kalman filter over poses, with backward smoothing."""
