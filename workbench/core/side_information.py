"""What a run may be given beforehand, beside the frames, and what was learned from other people: the words for it.

Parts declare by these words, in their traits, what they take: as `given` what comes with them or their keys, and as
`known` what they take where the dataset knows it.
"""

from collections.abc import Mapping
from types import MappingProxyType

START_POSE = "start"
MARKS = "marks"
FIRST_FRAMES = "first_frames"
LEAD_IN = "lead_in"
PHASE_ENDS = "phase_ends"
TRAJECTORY = "trajectory"
REST = "rest_of_body"
ROTATION = "rotation"
HEIGHT = "height"
LIMB_LENGTHS = "limb_lengths"
RADII = "radii"
CAMERA = "camera"
STILL_CAMERA = "still_camera"
STILL_BACKGROUND = "still_background"
GROUND_HEIGHT = "ground_height"

MEANING: Mapping[str, str] = MappingProxyType(
    {
        START_POSE: "the pose in the first frame",
        MARKS: "joints marked by hand in the first frame, which the start is fitted to",
        FIRST_FRAMES: "what the first frames show, which starts the run or measures the limbs, and is weighed again",
        LEAD_IN: "the poses up to the first frame",
        PHASE_ENDS: "the phases of the first and the last frame",
        TRAJECTORY: "how the rest of the body moves, from all frames of all cameras",
        REST: "that all but the part tracked stays as it starts",
        ROTATION: "that the torso does not turn, but stays as it starts",
        HEIGHT: "the person's height",
        LIMB_LENGTHS: "the person's limb lengths, all or some",
        RADII: "the radii of the person's limbs",
        CAMERA: "the camera's, or cameras', calibration",
        STILL_CAMERA: "that the camera and what is behind the person stand still",
        STILL_BACKGROUND: "what is behind the person, from the whole clip",
        GROUND_HEIGHT: "the height of the ground that the person stands on",
    }
)
"""What each word stands for, in the order in which lists give them."""
