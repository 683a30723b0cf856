"""Vocabulary of the side information that a run uses besides the frames and what was learned from other people.

Components declare it in their traits: as `given` what comes with them or their keys, and as `info` what they use where
the dataset knows it.
"""

START_POSE = "start"  # the pose in the first frame
MARKS = "marks"  # joints annotated by hand in the first frame, which the start is fitted to
FIRST_FRAMES = "first_frames"  # what they show, which starts the run or measures the limbs, and is weighed again
LEAD_IN = "lead_in"  # the poses up to the first frame
PHASE_ENDS = "phase_ends"  # the phases of the first and the last frame
TRAJECTORY = "trajectory"  # how the rest of the body moves, from all frames of all cameras
REST = "rest_of_body"  # that all but the part tracked stays as it starts
ROTATION = "rotation"  # that the torso does not turn, but stays as it starts
HEIGHT = "height"  # the person's height
LIMB_LENGTHS = "limb_lengths"  # the person's limb lengths, all or some
RADII = "radii"  # the radii of the person's limbs
CAMERA = "camera"  # the cameras' calibration
STILL_CAMERA = "still_camera"  # that the camera and what is behind the person stand still
STILL_BACKGROUND = "still_background"  # what is behind the person, from the whole clip
GROUND_HEIGHT = "ground_height"  # the height of the ground that the person stands on

ORDER = (
    START_POSE, MARKS, FIRST_FRAMES, LEAD_IN, PHASE_ENDS, TRAJECTORY, REST, ROTATION, HEIGHT, LIMB_LENGTHS, RADII,
    CAMERA, STILL_CAMERA, STILL_BACKGROUND, GROUND_HEIGHT,
)  # fmt: skip
"""The order in which a run lists it."""
