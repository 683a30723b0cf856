"""Initial poses from annotations and keypoints, and the limb lengths that they measure."""
