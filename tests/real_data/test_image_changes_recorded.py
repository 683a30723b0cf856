"""Recorded videos have no cuts, one that follows another in a file has one, and a recording that stalls is frozen."""

import cv2
import numpy as np
import pytest

from workbench.cameras.image_changes import ImageChanges, frozen
from workbench.utils.decode import decode, timestamps

SIZE, RATE_HZ, N = (640, 360), 30.0, 60
RECORDED = ["sports2d_walk/demo.mp4", *(f"pose2sim_balance/cam0{k}.mp4" for k in (1, 2, 3, 4))]
VIDEOS = ["squats.mp4", "pose1.mp4", "enter.avi", "asl.mkv", "car.mp4", "vtest.avi"]
"""A hand-held camera in a car, a room and a plaza, and others."""

pytestmark = pytest.mark.slow  # decodes hundreds of images


def _written(path, images):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, SIZE)
    for image in images:
        writer.write(cv2.resize(image[..., ::-1], SIZE, interpolation=cv2.INTER_AREA))
    writer.release()
    return path


def _changes(video):
    changes = ImageChanges()
    timestamps(video, 400, changes.add)
    return changes


@pytest.mark.parametrize("name", RECORDED)
def test_recorded_videos_have_no_cuts_and_are_not_frozen(data, name):
    changes = _changes(data / name)
    assert changes.cuts(RATE_HZ).size == 0
    assert not frozen(changes.repeated(), RATE_HZ).any()


@pytest.mark.parametrize("name", VIDEOS)
def test_everyday_videos_have_no_cuts(data, name):
    if not (video := data.parent / "videos" / name).is_file():
        pytest.skip(f"no {video}")
    assert _changes(video).cuts(RATE_HZ).size == 0


def test_two_videos_in_one_file_have_a_cut_between_them(data, tmp_path):
    """Two cameras show one man in one room from other sides, which is the harder case."""
    images = [image for name in RECORDED[1:3] for image in decode(data / name, 0, N - 1)]
    assert _changes(_written(tmp_path / "film.mp4", images)).cuts(RATE_HZ).tolist() == [N]


@pytest.mark.parametrize("name", RECORDED[:2])
def test_a_recording_that_stalls_is_frozen(data, name, tmp_path):
    """The encoder draws the repeated images anew every twelve frames, and sharpens them after it."""
    images = list(decode(data / name, 0, N - 1))
    stalled = _changes(_written(tmp_path / "stalled.mp4", [*images[:30], *[images[29]] * 48, *images[30:]]))
    is_frozen = frozen(stalled.repeated(), RATE_HZ)
    assert is_frozen[30:78].mean() > 0.7
    assert not np.delete(is_frozen, np.s_[30:78]).any()
