"""The body: skeleton, shape, limbs, forward kinematics, and the camera that sees it."""
