"""Where tracking starts: poses from marks and keypoints, and the limbs they measure."""
