"""The picture of the people in a video shows each with the number in the frame that shows the person best."""

import cv2
import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.association.target_selection import TrackedPeople
from workbench.detections.people_picture import write_people

RED, BLUE = (0, 0, 255), (255, 0, 0)


@pytest.fixture
def video(tmp_path):
    """Frame 0 is red, frame 1 blue."""
    (tmp_path / "walk").mkdir()
    for t, colour in enumerate((RED, BLUE)):
        cv2.imwrite(str(tmp_path / "walk" / f"{t}.png"), np.full((200, 400, 3), colour, np.uint8))
    return tmp_path / "walk"


def person(u, height):
    joints = np.full((len(JOINT_NAMES), 3), np.nan)
    joints[:3] = [[u - 10.0, 100.0 - 0.5 * height, 0.9], [u, 100.0, 0.9], [u + 10.0, 100.0 + 0.5 * height, 0.9]]
    return joints


def test_every_person_is_shown_in_the_best_frame_in_order_of_the_numbers(video, tmp_path):
    rows = [
        [np.array([person(100.0, 80.0), person(300.0, 120.0)])],
        [np.array([person(300.0, 90.0), person(110.0, 90.0)])],
    ]
    assigned = ({(0, 0): 0, (0, 1): 1}, {(0, 0): 1, (0, 1): 0})
    tracked = TrackedPeople(["walk"], np.arange(2), rows, assigned, np.full(2, np.inf))
    write_people(tmp_path / "people.png", video, tracked)
    picture = cv2.imread(str(tmp_path / "people.png"))
    assert picture.shape == (270, 360, 3)
    assert [tuple(picture[135, u].tolist()) for u in (90, 270)] == [BLUE, RED]  # person 0 is taller in frame 1


def test_many_people_fill_rows(video, tmp_path):
    rows = [[np.array([person(20.0 + 4.0 * k, 50.0) for k in range(70)])], [np.empty((0, len(JOINT_NAMES), 3))]]
    assigned = ({(0, k): k for k in range(70)}, {})
    tracked = TrackedPeople(["walk"], np.arange(2), rows, assigned, np.full(2, np.inf))
    write_people(tmp_path / "people.png", video, tracked)
    assert cv2.imread(str(tmp_path / "people.png")).shape == (8 * 270, 8 * 180, 3)
