"""What is fitted to all frames: a motion model, smooth poses, or one pose after the other."""
