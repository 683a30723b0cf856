"""Sources of frames and truth: rendered scenes, real video, points."""
