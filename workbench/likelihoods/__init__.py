"""Likelihoods log p(frame_t | pose_t, pose_t−1, frame_t−1)."""
