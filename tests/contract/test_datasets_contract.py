"""What every dataset promises, whatever it is made of."""

from dataclasses import fields

import cv2
import numpy as np
import pytest
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.core.dataset import Dataset, SequenceInfo
from workbench.datasets.blank import Blank
from workbench.datasets.multi_view import MultiView
from workbench.datasets.point_files import PointFiles
from workbench.datasets.points import Points
from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic
from workbench.datasets.video import Video

CAMERA = """
[{name}]
size = [40, 32]
matrix = [[50.0, 0.0, 19.5], [0.0, 50.0, 15.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [1.57, 0.0, 0.0]
translation = [0.0, 1.0, 4.0]
"""


def images(folder, n_frames=5):
    folder.mkdir()
    for number in range(n_frames):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((32, 40, 3), number, np.uint8))
    return str(folder)


def cameras(folder, *names):
    (folder / "cameras.toml").write_text("".join(CAMERA.format(name=name) for name in names))
    return str(folder / "cameras.toml")


def video(folder):
    (folder / "marks.csv").write_text("frame,joint,u,v,visible\n1,neck,3,4,1\n")
    files = {name: str(folder / "marks.csv") for name in ("initial_annotations", "keypoints", "eval_annotations")}
    return Video(images(folder / "film"), cameras(folder, "one"), first_frame=1, scale=0.5, rate_hz=30.0, **files)


def unmarked(folder):
    (folder / "marks.csv").write_text("frame,joint,u,v,visible\n0,neck,3,4,1\n")  # not in the frames used
    return Video(
        images(folder / "film"), cameras(folder, "one"), first_frame=1, n_frames=3, rate_hz=30.0,
        keypoints=str(folder / "marks.csv"),
    )  # fmt: skip


def multi_view(folder):
    sources = {name: images(folder / name, n) for name, n in (("left", 4), ("right", 5))}
    write(folder / "found", {t: [points("COCO_17", standing(10.0 + t, 4.0))] for t in range(5)})
    return MultiView(
        sources, cameras(folder, "left", "right"), rate_hz=10.0, keypoints={"left": str(folder / "found")}
    )  # fmt: skip


def point_files(folder, **given):
    for i in range(3):
        np.savez(folder / f"frame_{i}.npz", points=np.random.default_rng(i).standard_normal((20, 3)))
    return PointFiles(str(folder), max_points=20, **given)


SMALL = {"n_frames": 3, "width": 40, "height": 32, "focal_px": 50.0}
MADE = {
    "synthetic": lambda _: Synthetic(**SMALL, person_px=20.0, first_frame=2, keypoint_sigma_px=1.0),
    "synthetic_unseen": lambda _: Synthetic(**SMALL, person_px=20.0),
    "points": lambda _: Points(n_frames=3, n_points=20),
    "points_given": lambda _: Points(
        **SMALL, n_points=20, images=True, initialization="perturbed_truth", first_frame=4
    ),
    "stereo": lambda _: Stereo(n_frames=2, width=320, height=240, focal_px=350.0, baseline_m=0.4, n_points=20),
    "point_files": point_files,
    "point_files_given": lambda folder: point_files(folder, truth="builtin", initialization="perturbed_truth"),
    "video": video,
    "video_unmarked": unmarked,
    "multi_view": multi_view,
    "blank": lambda _: Blank(n_frames=4, first_frame=3),
}


@pytest.fixture(params=MADE)
def dataset(request, tmp_path) -> Dataset:
    return MADE[request.param](tmp_path)


def equal(first, second):
    """Whether two of anything that frames carry are the same to the bit."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        both = isinstance(first, np.ndarray) and isinstance(second, np.ndarray)
        return both and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(equal, first, second))
    if hasattr(first, "__dataclass_fields__"):
        return type(first) is type(second) and all(
            equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first)
        )
    return first == second


def test_frames_come_in_order_as_many_as_promised_and_again_alike(dataset):
    frames, again = list(dataset.frames()), list(dataset.frames())
    assert len(frames) == dataset.info.n_frames == len(again) > 0
    assert np.all(np.diff([frame.index for frame in frames]) == 1)
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 1.0 / dataset.info.rate_hz, rtol=1e-9)
    assert all(map(equal, frames, again))


def test_what_is_known_holds_of_the_frames(dataset):
    known, frames = dataset.info, list(dataset.frames())
    assert isinstance(known, SequenceInfo)
    assert known is dataset.info  # made once
    for frame in frames:
        assert equal(tuple(view.camera for view in frame.views), known.cameras)
    assert known.has_keypoints == any(view.keypoints is not None for frame in frames for view in frame.views)
    assert known.has_points == any(frame.points is not None for frame in frames)
    assert known.name
    assert 0.0 < known.scale <= 1.0
    assert known.initial_pose is None or known.initial_pose.shape == (len(POSE_NAMES),)
    if known.initial_annotations is not None:
        assert known.initial_annotations.keypoints.shape == (
            len(known.initial_annotations.times_s),
            len(JOINT_NAMES),
            3,
        )
        assert known.initial_annotations.times_s[0] == frames[0].time_s
    assert known.phase_ends is None or known.phase_ends[1] > known.phase_ends[0]
    if known.pose_history is not None:
        assert np.array_equal(known.pose_history[-1], known.initial_pose)
        assert known.pose_history_activity is not None


def test_what_frames_carry_has_the_promised_shape(dataset):
    shapes = {"pose": (len(POSE_NAMES),), "joints": (len(JOINT_NAMES), 3), "marks": (len(JOINT_NAMES), 2),
              "marks_visible": (len(JOINT_NAMES),)}  # fmt: skip
    for frame in dataset.frames():
        assert frame.points is None or frame.points.shape == (len(frame.points), 3)
        for view in frame.views:
            size = (view.camera.height, view.camera.width)
            assert view.image.dtype == np.uint8
            assert view.image.shape in (size, (*size, 3))
            assert view.keypoints is None or view.keypoints.shape == (len(JOINT_NAMES), 3)
        for name, shape in shapes.items():
            value = getattr(frame.truth, name, None)
            assert value is None or value.shape == shape
