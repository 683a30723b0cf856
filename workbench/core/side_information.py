"""Vocabulary of the side information that a run uses besides the frames and what was learned from other people.

Components declare it in their traits: as `given` what comes with them or their keys, and as `info` what they use where
the dataset knows it.
"""

INITIAL_POSE = "initial_pose"  # the pose in the first frame
INITIAL_ANNOTATIONS = "initial_annotations"  # joints annotated by hand in the first frame, which the start is fitted to
FIRST_FRAMES = "first_frames"  # what they show, which starts the run or measures the limbs, and is weighed again
POSE_HISTORY = "pose_history"  # the poses up to the first frame
PHASE_ENDS = "phase_ends"  # the phases of the first and the last frame
TRAJECTORY = "trajectory"  # how the rest of the body moves, from all frames of all cameras
FIXED_OTHER_JOINTS = "fixed_other_joints"  # that all but the part tracked stays as it starts
FIXED_TORSO_ORIENTATION = "fixed_torso_orientation"  # that the torso does not turn, but stays as it starts
HEIGHT = "height"  # the person's height
LIMB_LENGTHS = "limb_lengths"  # the person's limb lengths, all or some
LIMB_RADII = "limb_radii"  # the radii of the person's limbs
CAMERA_CALIBRATION = "camera_calibration"  # the cameras' calibration
STATIC_CAMERA = "static_camera"  # that the camera and what is behind the person stand still
STATIC_BACKGROUND = "static_background"  # what is behind the person, from the whole clip
GROUND_HEIGHT = "ground_height"  # the height of the ground that the person stands on

ORDER = (
    INITIAL_POSE, INITIAL_ANNOTATIONS, FIRST_FRAMES, POSE_HISTORY, PHASE_ENDS, TRAJECTORY, FIXED_OTHER_JOINTS,
    FIXED_TORSO_ORIENTATION, HEIGHT, LIMB_LENGTHS, LIMB_RADII, CAMERA_CALIBRATION, STATIC_CAMERA, STATIC_BACKGROUND,
    GROUND_HEIGHT,
)  # fmt: skip
"""The order in which a run lists it."""
