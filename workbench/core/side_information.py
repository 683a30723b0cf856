"""Names of the side information that a run uses in addition to the frames and the models learned from other people.

Components declare it in their traits: under `assumptions` if they always use it, or their keys set it, and under
`optional_assumptions` if they use it when the dataset provides it.
"""

INITIAL_POSE = "initial_pose"  # the pose in the first frame
INITIAL_ANNOTATIONS = "initial_annotations"  # manual ones of the first frame, to which the initial pose is fitted
FIRST_FRAMES = "first_frames"  # observations that initialize the run or the limb lengths and are used again
POSE_HISTORY = "pose_history"  # the poses up to the first frame
PHASE_ENDS = "phase_ends"  # the phases of the first and the last frame
TRAJECTORY = "trajectory"  # motion of the rest of the body, from all frames of all cameras
FIXED_OTHER_JOINTS = "fixed_other_joints"  # parameters that are not tracked keep their initial values
FIXED_TORSO_ORIENTATION = "fixed_torso_orientation"  # the torso keeps its initial orientation
HEIGHT = "height"  # the person's height
LIMB_LENGTHS = "limb_lengths"  # the person's limb lengths, all or some
LIMB_RADII = "limb_radii"  # the radii of the person's limbs
CAMERA_CALIBRATION = "camera_calibration"  # the cameras' calibration
STATIC_CAMERA = "static_camera"  # the camera and the background do not move
STATIC_BACKGROUND = "static_background"  # the background image, estimated from the whole clip
GROUND_HEIGHT = "ground_height"  # the height of the ground that the person stands on

ORDER = (
    INITIAL_POSE, INITIAL_ANNOTATIONS, FIRST_FRAMES, POSE_HISTORY, PHASE_ENDS, TRAJECTORY, FIXED_OTHER_JOINTS,
    FIXED_TORSO_ORIENTATION, HEIGHT, LIMB_LENGTHS, LIMB_RADII, CAMERA_CALIBRATION, STATIC_CAMERA, STATIC_BACKGROUND,
    GROUND_HEIGHT,
)  # fmt: skip
"""Order in which a run lists its side information."""
