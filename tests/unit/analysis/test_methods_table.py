"""The table of other methods and ours: perfect estimates have no error, in space or in the image's plane."""

import numpy as np
from view_scenes import swinging

from analysis.tables.methods import LANDMARKS, OURS, PLANAR, cells, scored
from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, Truth, View

CAMERA = plain_camera(640, 480, 500.0, (4.0, 0.0, 1.0), (0.0, 0.0, 1.0))
PLACES = joints(person_skeleton(from_height(1.7)), swinging(person_skeleton(from_height(1.7)))[1])
IMAGE = np.zeros((480, 640), np.uint8)


def frames(truth):
    """Return frames with true landmarks, turned and scaled, and true keypoints, and a truth by the joints (J, 3)."""
    views = []
    for place in PLACES:
        keypoints = np.column_stack([CAMERA.project(place), np.full(len(place), 0.9)])
        views.append(View(CAMERA, IMAGE, keypoints, 0.9 * (place - place[0]) @ CAMERA.rotation.T))
    return [
        Frame(k, k / 30.0, (view,), truth(place)) for k, (view, place) in enumerate(zip(views, PLACES, strict=True))
    ]


def test_a_perfect_estimate_has_no_error_in_space():
    rows = {name: cells([each]) for name, each in scored(frames(lambda place: Truth(joints=place)), [*PLACES]).items()}
    assert rows[LANDMARKS] == rows[OURS] == ["0.0", "0.0", "0"]
    assert float(rows[PLANAR][0]) > 1.0  # foreshortened
    assert rows[PLANAR][2] == "–"


def test_annotations_are_compared_in_the_image_alone():
    rows = scored(frames(lambda place: Truth(annotations=CAMERA.project(place))), [*PLACES])
    assert cells([rows[PLANAR]]) == ["0.0", "0.0", "–"]
    assert cells([rows[OURS]])[2] == "–"


def test_an_annotation_that_is_not_visible_and_a_frame_without_truth_do_not_count():
    visible = np.ones(15, dtype=bool)
    visible[[10, 13]] = False  # the knees
    some = frames(lambda place: Truth(annotations=CAMERA.project(place), annotations_visible=visible))
    some[0] = Frame(0, 0.0, some[0].views)
    rows = scored(some, [*PLACES])
    assert cells([rows[PLANAR]]) == ["–", "0.0", "–"]
    assert len(rows[OURS].distances_mm) == len(PLACES) - 1
