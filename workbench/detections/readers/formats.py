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

SIZES = frozenset(map(len, LAYOUTS.values()))
"""Numbers of points of all layouts."""

PEOPLE_KEYS = ("people", "bodies", "instances", "instance_info", "predictions", "poses")
"""Keys of the list of people of one image, of OpenPose, AlphaPose, MMPose, MMPose's and Sapiens' file by image,
OpenPifPaf and PoseNet."""
FRAME_KEYS = ("image_id", "frame_id", "frame_idx", "frame_index", "frame_number", "frame", "image_name", "image", "img")
"""Keys of the image, by number or name, in a list of people (AlphaPose, COCO's results) or of images (MMPose's
inferencer); and, in lower case, of the column of a table (SLEAP, MediaPipe)."""
FRAMES_KEYS = ("instance_info", "frames", "predictions", "annotations")
"""Keys of such a list in a file with more than it, of MMPose's predictions and COCO's annotations without images."""
DATASET_KEYS = ("images", "annotations")
"""Keys of COCO's data sets: images with their id, and annotations of people with the id of their image."""
PERSON_KEYS: Mapping[str, tuple[str, ...]] = {
    "pose_keypoints": (),  # OpenPose's first version
    "pose_keypoints_2d": (),  # OpenPose
    "joints": (),  # AlphaPose in the form of CMU
    "keypoints": ("keypoint_scores", "keypoints_scores", "scores"),  # AlphaPose and COCO, or MMPose with scores
    "landmarks": (),  # MediaPipe
    "pose_landmarks": (),
}
"""Keys of a person's coordinates, u, v, confidence of one point after the other, or without confidence; and the keys of
confidences of their own, with which the coordinates are u, v. Points may also be mappings or lists by COORDINATES."""
COORDINATES: Mapping[str, int] = {
    "x": 0, "y": 1, "u": 0, "v": 1, "likelihood": 2, "score": 2, "visibility": 2, "visible": 2, "confidence": 2,
    "conf": 2, "c": 2, "p": 2,
}  # fmt: skip
"""Names of the coordinates u, v and of the confidence, in tables (DeepLabCut, SLEAP, MediaPipe) and in JSON."""
POINT_NAME_KEYS = ("name", "part")
"""Keys of a point's name where points are mappings."""
TEXT_COLUMNS = 5
"""Numbers before the points in Ultralytics' text files, of a person a line: class and box. After the points there may
be the box's confidence and the person's number."""
WORLD_KEY = "world_landmarks"
"""Key of the points in space that the workbench's own detector adds, see `People`."""
NUMBER_KEY, REGION_KEY = "person_id", "region"
"""Keys of a person's number, a list of one, and of the region in which the workbench's own detector looks for the
person next; the number then identifies a person whom it follows. OpenPose's own number is -1."""
