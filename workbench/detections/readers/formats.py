"""Formats of detected joints: the points of each detector in order, and the keys of its JSON files.

Another detector is another row of these tables, and a test that its points are the right joints.
"""

from collections.abc import Mapping

_ARMS = "right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist"
_LEGS = "right_hip right_knee right_ankle left_hip left_knee left_ankle"
_FACE = "right_eye left_eye right_ear left_ear"
_COCO = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist "
    "right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
)
_FEET = "left_big_toe left_small_toe left_heel right_big_toe right_small_toe right_heel"
_BODY_25B = f"{_COCO} neck head_top {_FEET}"
_HALPE = f"{_COCO} head_top neck pelvis left_big_toe right_big_toe left_small_toe right_small_toe left_heel right_heel"
_OTHER = " -"
"""A point of the face or of a hand."""
_LAYOUTS = {
    "BODY_25": f"nose shoulders {_ARMS} pelvis {_LEGS} {_FACE} {_FEET}",
    "BODY_25B": _BODY_25B,
    "BODY_135": _BODY_25B + 110 * _OTHER,
    "HALPE_26": _HALPE,
    "HALPE_136": _HALPE + 110 * _OTHER,
    "COCO_18": f"nose shoulders {_ARMS} {_LEGS} {_FACE}",
    "COCO_17": _COCO,
    "COCO_133": f"{_COCO} {_FEET}" + 110 * _OTHER,
    "MPII_16": "right_ankle right_knee right_hip left_hip left_knee left_ankle pelvis thorax neck head_top "
    "right_wrist right_elbow right_shoulder left_shoulder left_elbow left_wrist",
    "MPI_15": f"head_top shoulders {_ARMS} {_LEGS} chest",
    "BLAZEPOSE_33": "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer "
    "left_ear right_ear mouth_left mouth_right "
    "left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
    "left_pinky right_pinky left_index right_index left_thumb right_thumb "
    "left_hip right_hip left_knee right_knee left_ankle right_ankle "
    "left_heel right_heel left_foot_index right_foot_index",
}
LAYOUTS: Mapping[str, tuple[str, ...]] = {name: tuple(points.split()) for name, points in _LAYOUTS.items()}
"""The names of the points of each layout, in order. A point with the name of a joint is that joint; the head's centre
follows from the points head_top and neck, or from the ears, see `layout_joints`. OpenPose's own "neck", the middle of
the shoulders, is below ours and is called "shoulders". The points of face and feet distinguish layouts with the same
number of points, see `matching_layout`."""

PEOPLE_KEYS = ("people", "bodies")
"""Keys of the list of people of one image; the second one is AlphaPose's."""
IMAGE_KEY = "image_id"
"""Key of a person's image, in a file that is a list of people, of AlphaPose and COCO."""
PERSON_KEYS: Mapping[str, str | None] = {
    "pose_keypoints": None,  # OpenPose's first version
    "pose_keypoints_2d": None,  # OpenPose
    "joints": None,  # AlphaPose in the form of CMU
    "keypoints": "keypoint_scores",  # AlphaPose and COCO, or MMPose with scores of their own
}
"""Keys of a person's coordinates, u, v, confidence of one point after the other; and the key of the confidences, if a
person has it: then the coordinates are u, v."""
WORLD_KEY = "world_landmarks"
"""Key of the points in space that the workbench's own detector adds, see `People`."""
NUMBER_KEY, REGION_KEY = "person_id", "region"
"""Keys of a person's number, a list of one, and of the region in which the workbench's own detector looks for the
person next; the number then identifies a person whom it follows. OpenPose's own number is -1."""
