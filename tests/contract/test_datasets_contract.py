"""What every dataset promises, whatever it is made of."""

import cv2
import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.datasets.frame import Dataset
from workbench.datasets.synthetic import Synthetic
from workbench.datasets.video import Video

CAMERA = """
[one]
size = [40, 32]
matrix = [[50.0, 0.0, 19.5], [0.0, 50.0, 15.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [1.57, 0.0, 0.0]
translation = [0.0, 1.0, 4.0]
"""


@pytest.fixture(params=["synthetic", "video"])
def dataset(request, tmp_path) -> Dataset:
    if request.param == "synthetic":
        return Synthetic(
            n_frames=3, width=40, height=32, person_px=20.0, focal_px=50.0, first_frame=2, keypoint_sigma_px=1.0
        )
    for number in range(5):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((32, 40, 3), number, np.uint8))
    (tmp_path / "camera.toml").write_text(CAMERA)
    (tmp_path / "marks.csv").write_text("frame,joint,u,v,visible\n1,neck,3,4,1\n")
    files = {name: str(tmp_path / "marks.csv") for name in ("start_marks", "keypoints", "eval_marks")}
    return Video(str(tmp_path), str(tmp_path / "camera.toml"), first_frame=1, scale=0.5, rate_hz=30.0, **files)


def test_frames_come_in_order_as_many_as_promised_and_again_alike(dataset):
    frames, again = list(dataset.frames()), list(dataset.frames())
    assert len(frames) == len(dataset) == len(again) > 0
    assert np.all(np.diff([frame.index for frame in frames]) == 1)
    assert np.all(np.diff([frame.time_s for frame in frames]) > 0.0)
    assert any(frame.views[0].keypoints is not None for frame in frames)
    for first, second in zip(frames, again, strict=True):
        seen, seen_again = first.views[0].keypoints, second.views[0].keypoints
        assert np.array_equal(seen, seen_again, equal_nan=seen is not None)
        assert (first.index, first.time_s) == (second.index, second.time_s)
        assert np.array_equal(first.views[0].image, second.views[0].image)


def test_images_fit_their_camera(dataset):
    for frame in dataset.frames():
        for view in frame.views:
            assert view.image.dtype == np.uint8
            assert view.image.shape in (
                (view.camera.height, view.camera.width),
                (view.camera.height, view.camera.width, 3),
            )


def test_what_is_known_has_the_promised_shape(dataset):
    assert isinstance(dataset.name, str)
    assert dataset.name
    assert 0.0 < dataset.scale <= 1.0
    assert dataset.start_pose is not None or dataset.start_marks is not None
    if dataset.start_pose is not None:
        assert dataset.start_pose.shape == (len(POSE_NAMES),)
    if dataset.start_marks is not None:
        assert dataset.start_marks.keypoints.shape == (len(dataset.start_marks.times_s), len(JOINT_NAMES), 3)
        assert dataset.start_marks.times_s[0] == next(dataset.frames()).time_s
    for frame in dataset.frames():
        assert all(view.keypoints is None or view.keypoints.shape == (len(JOINT_NAMES), 3) for view in frame.views)
        truth = frame.truth
        if truth is not None and truth.joints is not None:
            assert truth.joints.shape == (len(JOINT_NAMES), 3)
        if truth is not None and truth.marks is not None:
            assert truth.marks.shape == (len(JOINT_NAMES), 2)
            assert truth.marks_visible.shape == (len(JOINT_NAMES),)
