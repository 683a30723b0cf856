"""The contract of every dataset: order, number, shapes and repeatability of its frames."""

from dataclasses import fields

import cv2
import numpy as np
import pytest
from humaneva_files import write as write_humaneva
from openpose_scenes import points, standing, write
from video_files import camera_table

from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.core.dataset import Dataset, SequenceInfo
from workbench.core.frame_cache import FrameCache, without_images
from workbench.datasets.blank import Blank
from workbench.datasets.humaneva import HumanEva
from workbench.datasets.multi_view import MultiView
from workbench.datasets.point_files import PointFiles
from workbench.datasets.points import Points
from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic
from workbench.datasets.video import Video


def images(folder, n_frames=5):
    folder.mkdir()
    for number in range(n_frames):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((32, 40, 3), number, np.uint8))
    return str(folder)


def cameras(folder, *names):
    (folder / "cameras.toml").write_text("".join(camera_table(name, (40, 32), 50.0) for name in names))
    return str(folder / "cameras.toml")


def video(folder):
    (folder / "annotations.csv").write_text("frame,joint,u,v,visible\n1,neck,3,4,1\n")
    files = {name: str(folder / "annotations.csv") for name in ("initial_annotations", "keypoints", "eval_annotations")}
    return Video(images(folder / "film"), cameras(folder, "one"), first_frame=1, scale=0.5, rate_hz=30.0, **files)


def video_without_annotations(folder):
    (folder / "annotations.csv").write_text("frame,joint,u,v,visible\n0,neck,3,4,1\n")  # not in the frames used
    return Video(
        images(folder / "film"), cameras(folder, "one"), first_frame=1, n_frames=3, rate_hz=30.0,
        keypoints=str(folder / "annotations.csv"),
    )  # fmt: skip


def multi_view(folder):
    sources = {name: images(folder / name, n) for name, n in (("left", 4), ("right", 5))}
    write(folder / "detections", {t: [points("COCO_17", standing(10.0 + t, 4.0))] for t in range(5)})
    return MultiView(
        sources, cameras(folder, "left", "right"), rate_hz=10.0, keypoints={"left": str(folder / "detections")}
    )  # fmt: skip


def humaneva(folder):
    write_humaneva(folder)
    return HumanEva(folder=str(folder), cameras=["C2", "BW1"], initialization="truth", n_frames=3)


def point_files(folder, **options):
    for i in range(3):
        np.savez(folder / f"frame_{i}.npz", points=np.random.default_rng(i).standard_normal((20, 3)))
    return PointFiles(str(folder), max_points=20, **options)


SMALL = {"n_frames": 3, "width": 40, "height": 32, "focal_px": 50.0}
BUILDERS = {
    "synthetic": lambda _: Synthetic(**SMALL, person_px=20.0, first_frame=2, keypoint_sigma_px=1.0),
    "synthetic_without_keypoints": lambda _: Synthetic(**SMALL, person_px=20.0),
    "points": lambda _: Points(n_frames=3, n_points=20),
    "points_with_images": lambda _: Points(
        **SMALL, n_points=20, images=True, initialization="perturbed_truth", first_frame=4
    ),
    "stereo": lambda _: Stereo(n_frames=2, width=320, height=240, focal_px=350.0, baseline_m=0.4, n_points=20),
    "point_files": point_files,
    "point_files_with_truth": lambda folder: point_files(folder, truth="builtin", initialization="perturbed_truth"),
    "video": video,
    "video_without_annotations": video_without_annotations,
    "multi_view": multi_view,
    "humaneva": humaneva,
    "blank": lambda _: Blank(n_frames=4, first_frame=3),
}


@pytest.fixture(params=BUILDERS)
def dataset(request, tmp_path, trusted) -> Dataset:
    return BUILDERS[request.param](tmp_path)


def equal(first, second):
    """Return whether two values of frames are bitwise identical."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        arrays = isinstance(first, np.ndarray) and isinstance(second, np.ndarray)
        return arrays and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(equal, first, second))
    if hasattr(first, "__dataclass_fields__"):
        return type(first) is type(second) and all(
            equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first)
        )
    return first == second


def test_frames_are_ordered_counted_and_repeatable(dataset):
    frames, repeated = list(dataset.frames()), list(dataset.frames())
    assert len(frames) == dataset.info.n_frames == len(repeated) > 0
    assert np.all(np.diff([frame.index for frame in frames]) == 1)
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 1.0 / dataset.info.rate_hz, rtol=1e-9)
    assert all(map(equal, frames, repeated))
    observed = list(without_images(FrameCache(dataset)))
    assert all(equal(frame.without_images, other) for frame, other in zip(frames, observed, strict=True))


def test_the_sequence_info_describes_the_frames(dataset):
    info, frames = dataset.info, list(dataset.frames())
    assert isinstance(info, SequenceInfo)
    assert info is dataset.info  # computed once
    for frame in frames:
        assert equal(tuple(view.camera for view in frame.views), info.cameras)
    assert info.has_keypoints == any(view.keypoints is not None for frame in frames for view in frame.views)
    assert info.has_points == any(frame.points is not None for frame in frames)
    assert info.name
    assert 0.0 < info.scale <= 1.0
    assert info.initial_pose is None or info.initial_pose.shape == (len(POSE_NAMES),)
    if info.initial_annotations is not None:
        assert info.initial_annotations.keypoints.shape == (len(info.initial_annotations.times_s), len(JOINT_NAMES), 3)
        assert info.initial_annotations.times_s[0] == frames[0].time_s
    assert info.phase_ends is None or info.phase_ends[1] > info.phase_ends[0]
    if info.pose_history is not None:
        assert np.array_equal(info.pose_history[-1], info.initial_pose)
        assert info.pose_history_activity is not None


def test_arrays_of_frames_have_the_documented_shapes(dataset):
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
