"""Dataset of HumanEva I and II: synchronized videos with the benchmark's partitions, synchronization and truth."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from workbench.body.angles import N_POSITION
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import JOINT_NAMES, Skeleton, joint_of, middle_of, person_skeleton
from workbench.body.stature import limb_lengths, usual_height
from workbench.core.capabilities import IMAGES, KEYPOINTS, START, Traits, component_traits
from workbench.core.checks import RATE, UP_TO_1, at_least, check, one_of, optional
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth
from workbench.core.side_information import INITIAL_POSE
from workbench.datasets.multi_view import MultiView
from workbench.motion.formats.humaneva import read_capture, virtual_markers
from workbench.motion.formats.text import numbers, read_lines
from workbench.motion.retarget import refine
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_path import InputPath, expanded

log = logging.getLogger(__name__)

_FIRST = 6
"""Number, from 1, of the first frame used, as the codec repeats the first images."""
_LAST: Mapping[str, Mapping[str, tuple[int | None, int | None, int]]] = {
    "S1": {"Walking": (590, 1203, 1004), "Jog": (367, 740, 874), "ThrowCatch": (473, 945, 951),
           "Gestures": (395, 801, 1070), "Box": (385, 789, 606), "Combo": (None, None, 2602)},
    "S2": {"Walking": (438, 876, 1093), "Jog": (398, 795, 727), "ThrowCatch": (550, 1128, 1399),
           "Gestures": (500, 901, 1062), "Box": (382, 734, 989), "Combo": (None, None, 2054)},
    "S3": {"Walking": (448, 939, 805), "Jog": (401, 842, 864), "ThrowCatch": (493, 1027, 1000),
           "Gestures": (533, 1102, 553), "Box": (512, 1021, 753), "Combo": (None, None, 1798)},
    "S4": {"Walking": (None, None, 667), "Jog": (None, None, 590), "ThrowCatch": (None, None, 773),
           "Gestures": (None, None, 459), "Box": (None, None, 574), "Combo": (None, None, 1102)},
}  # fmt: skip
"""HumanEva I: numbers of the last frames for validation and training in trial 1, and for the test in trial 2."""
_SECOND = {("S2", 1): (1, 1202), ("S4", 4): (2, 1258)}
"""HumanEva II, Combo: the first and the last frame by subject and trial."""
_PARTITIONS = ("validate", "train", "test")
_COLOUR, _GREY = ("C1", "C2", "C3", "C4"), ("BW1", "BW2", "BW3", "BW4")
_WRONG_HEADS = ("S3",)
"""Subjects whose markers of the head are known to be wrong."""
_FITS = 10
"""Repetitions of the fit of the initial pose, each from the last one."""


@dataclass(frozen=True)
class _Sync:
    """Synchronization of a trial. Frame k, from 1, is image first_images[camera] + k − 1 of a camera, from 0, and the
    row first_row + (k − 1) rows_per_frame of the motion capture, from 0."""

    first_images: Mapping[str, int]
    first_row: float
    rows_per_frame: float


@dataclass(kw_only=True, eq=False)
class HumanEva:
    """One trial of HumanEva I or II (Sigal, Balan & Black, IJCV 87, 2010), with its frames of one partition.

    The frames of the cameras belong together as in the benchmark, which rounds to whole images. The truth of a frame is
    interpolated between those of the motion capture, and missing where one of the 39 markers is. Its joints are the
    virtual markers, except for the pelvis, between the hips, and the head's centre, between its four markers; errors
    humaneva_mm and humaneva_px are of the virtual markers alone. Raises InputError for an unknown trial, and `info` for
    missing or damaged files and for a pose of the truth where there is none.

    Parameters
    ----------
    folder : with the folders S1 to S4 as published, each with Image_Data, Calibration_Data, Sync_Data and, for the
        truth, Mocap_Data with Static.c3d and S1.mp.
    subject, action : such as S1 and Walking.
    partition : validate or train, the first and the second part of trial 1, or test, trial 2; HumanEva II has a test
        only.
    trial : 1 or 4 for HumanEva II, whose action is Combo; None for HumanEva I.
    cameras : names of the cameras, C1 to C3 (II: C4) in colour, BW1 to BW4 in black and white.
    n_frames : number of frames from the partition's first on; None: all.
    rate_hz : of the cameras.
    initialization : "truth", the true pose in the first frame with one, at which the sequence begins then, and the true
        lengths of limbs; "auto", neither.
    keypoints, person, keypoint_layout, detector, cache, scale : as for `MultiView`.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images, and keypoints and the initial pose where they are set."""
        keypoints = (KEYPOINTS, START) if keys.get("keypoints") else ()
        initial_pose = (START, INITIAL_POSE) if keys.get("initialization") == "truth" else ()
        return component_traits(IMAGES, *keypoints, *initial_pose)

    folder: InputPath
    subject: str = "S1"
    action: str = "Walking"
    partition: str = "validate"
    trial: int | None = None
    cameras: Sequence[str] = ("C1", "C2", "C3")
    n_frames: int | None = None
    rate_hz: float = 60.0
    scale: float = 1.0
    initialization: str = "auto"
    keypoints: Mapping[str, InputPath] | str | None = None
    keypoint_layout: str | None = None
    person: int | str | None = None
    detector: str = "full"
    cache: str = "~/.cache/workbench"

    def __post_init__(self) -> None:
        ranges = {"partition": one_of(*_PARTITIONS), "initialization": one_of("auto", "truth"), "rate_hz": RATE}
        check("humaneva", self, **ranges, scale=UP_TO_1, n_frames=optional(at_least(1)))
        _ = self._span
        if not self.cameras or not set(self.cameras) <= {*_COLOUR, *_GREY}:
            expected = ", ".join((*_COLOUR, *_GREY))
            raise InputError(
                f"humaneva: cameras: expected some of {expected}, found {', '.join(self.cameras) or 'none'}"
            )

    @cached_property
    def info(self) -> SequenceInfo:
        """Metadata of the videos, and the person's lengths and first pose by the truth."""
        info = replace(self._views.info, name=f"{self.subject} {self._trial}")
        if self.initialization == "auto":
            return info
        _, joints = self._truth
        complete = joints[np.isfinite(joints).all(axis=(1, 2))]
        shape = _shape(complete)
        return replace(info, shape=shape, initial_pose=_fitted_pose(person_skeleton(shape), complete[0]))

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the cameras with their truth, numbered as the images of the first camera."""
        return self._with_truth(self._views.frames())

    def frames_without_images(self) -> Iterator[Frame]:
        """Yield the same frames with empty images, without decoding them."""
        return self._with_truth(self._views.frames_without_images())

    def _with_truth(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        offset = self._sync.first_images[self.cameras[0]] + self._span[0] - 1
        head = JOINT_NAMES.index("head_centre")
        for frame in frames:
            markers, joints = (each[frame.index - offset].copy() for each in self._truth)
            if self.subject in _WRONG_HEADS:
                markers[head] = joints[head] = np.nan
            truth = Truth(joints=joints, virtual_markers=markers) if np.isfinite(joints).any() else None
            yield replace(frame, truth=truth)

    @property
    def _trial(self) -> str:
        trial = self.trial if self.trial is not None else 2 if self.partition == "test" else 1
        return f"{self.action}_{trial}"

    @property
    def _span(self) -> tuple[int, int]:
        """Numbers, from 1, of the partition's first and last frame, before n_frames."""
        if self.trial is not None and self.action == "Combo" and (self.subject, self.trial) in _SECOND:
            if self.partition != "test":
                raise InputError(f"humaneva: HumanEva II has partition=test only, found {self.partition}")
            return _SECOND[self.subject, self.trial]
        if self.trial is not None:
            found = f"{self.subject} {self.action} {self.trial}"
            raise InputError(f"humaneva: trial is of HumanEva II, expected S2 Combo 1 or S4 Combo 4, found {found}")
        ends = _LAST.get(self.subject, {}).get(self.action)
        last = None if ends is None else ends[_PARTITIONS.index(self.partition)]
        if ends is None or last is None:
            raise InputError(
                f"humaneva: there is no {self.action} of {self.subject} in partition={self.partition}; S1 to S3 have "
                f"{', '.join(_LAST['S1'])} (Combo and all of S4 in the test alone)"
            )
        return (ends[0] or 0) + 1 if self.partition == "train" else _FIRST, last

    @cached_property
    def _used(self) -> tuple[int, int]:
        """Numbers of the first and the last frame used; with a pose of the truth, the first has one."""
        first, last = self._span
        if self.initialization == "truth":
            valid = np.flatnonzero(np.isfinite(self._truth[1]).all(axis=(1, 2)))
            if not len(valid):
                raise InputError(f"{self._motion}: expected a frame with all markers for the initial pose, found none")
            if valid[0]:
                log.warning("%s: the first %d frames lack markers and are left out", self._trial, valid[0])
            first += int(valid[0])
        return first, last if self.n_frames is None else min(last, first + self.n_frames - 1)

    @cached_property
    def _views(self) -> MultiView:
        first, last = self._used
        images, start = self._sync.first_images, self._sync.first_images[self.cameras[0]]
        return MultiView(
            {name: str(self._images(name)) for name in self.cameras}, str(self._place("Calibration_Data")),
            first_frame=start + first - 1, n_frames=last - first + 1, scale=self.scale, rate_hz=self.rate_hz,
            keypoints=self.keypoints or {}, person=self.person, detector=self.detector, cache=self.cache,
            keypoint_layout=self.keypoint_layout,
            offsets_s={name: (start - images[name]) / self.rate_hz for name in self.cameras},
        )  # fmt: skip

    @cached_property
    def _sync(self) -> _Sync:
        return _synchronization(self._place("Sync_Data"), self._trial, self.cameras)

    @cached_property
    def _truth(self) -> tuple[FloatArray, FloatArray]:
        """Virtual markers (T, J, 2, 3) and joints (T, J, 3), m, of the partition's frames; NaN where unknown."""
        n = self._span[1] - self._span[0] + 1
        if not self._motion.is_file():
            joints = np.full((n, len(JOINT_NAMES), 3), np.nan)
            return np.stack([joints, joints], axis=2), joints
        static, measured = (self._place("Mocap_Data") / name for name in ("Static.c3d", f"{self.subject}.mp"))
        rows: FloatArray = (
            self._sync.first_row + np.arange(self._span[0] - 1.0, self._span[1]) * self._sync.rows_per_frame
        )
        markers, heads = virtual_markers(read_capture(self._motion, static, measured), rows)
        joints, hips = markers.mean(axis=2), [JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]
        joints[:, JOINT_NAMES.index("pelvis")] = joints[:, hips].mean(axis=1)
        joints[:, JOINT_NAMES.index("head_centre")] = heads
        return markers, joints

    @property
    def _motion(self) -> Path:
        return self._place("Mocap_Data") / f"{self._trial}.c3d"

    def _place(self, name: str) -> Path:
        return expanded(self.folder) / self.subject / name

    def _images(self, camera: str) -> Path:
        """Return the video of a camera, or its folder of images in HumanEva II."""
        place = self._place("Image_Data") / f"{self._trial}_({camera})"
        return place if place.is_dir() else place.with_name(f"{place.name}.avi")


def _synchronization(folder: Path, trial: str, cameras: Sequence[str]) -> _Sync:
    """Return a trial's synchronization from all of its .ofs files.

    A file has the number of an image, that of the captured row at its time, both from 1, and the rows per image. The
    reference is the first camera's file, in the order of the benchmark; all cameras begin with the earliest frame that
    they have in common with the capture, and the rows per image are the mean.
    """
    files = {name: folder / f"{trial}_({name}).ofs" for name in (*_COLOUR, *_GREY)}
    tables = {name: _offsets(path) for name, path in files.items() if path.is_file() or name in cameras}
    images, rows, scales = np.array(list(tables.values())).T
    starts, scale = images + (rows[0] - rows) / scales, float(scales.mean())
    row = rows[0] - scale * (starts.min() - 1.0)
    starts = starts - starts.min() + 1.0
    if row < 1.0:
        starts, row = starts - (row - 1.0) / scale, 1.0
    firsts = np.floor(starts + 0.5).astype(int) - 1  # as in the benchmark, halves are rounded up
    return _Sync(dict(zip(tables, firsts.tolist(), strict=True)), float(row) - 1.0, scale)


def _offsets(path: Path) -> tuple[float, float, float]:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the synchronization of the camera with the motion capture")
    words = " ".join(read_lines(path)).split()
    image, row, scale = numbers(path, 1, words, 3, "the synchronization")
    if not scale > 0.0:
        raise InputError(f"{path}: expected a positive number of captured rows per image, found {scale:g}")
    return image, row, scale


def _shape(joints: FloatArray) -> Shape:
    """Return a person with the lengths, medians over frames, of joints (F, J, 3), m."""

    def distance(first: FloatArray, second: FloatArray) -> float:
        return float(np.median(np.linalg.norm(first - second, axis=-1)))

    lengths = limb_lengths(joints)
    shoulders, hips = (
        [joint_of(joints, f"{side}_{name}") for side in ("left", "right")] for name in ("shoulder", "hip")
    )
    neck, pelvis, head = (joint_of(joints, name) for name in ("neck", "pelvis", "head_centre"))
    return from_height(
        usual_height(lengths), **lengths, neck=(0.0, 0.0, distance(neck, pelvis)),
        shoulder=(0.0, 0.5 * distance(*shoulders), distance(middle_of(joints, "shoulder"), pelvis)),
        hip=(0.0, 0.5 * distance(*hips), 0.0), head=(0.0, 0.0, distance(head, neck)),
    )  # fmt: skip


def _fitted_pose(skeleton: Skeleton, joints: FloatArray) -> FloatArray:
    """Return the pose (P,) that fits joints (J, 3), m, by repeated steps within the limits from a neutral pose that
    faces as the hips do."""
    pose = np.zeros((1, len(skeleton.dof_names)))
    across = joint_of(joints, "left_hip") - joint_of(joints, "right_hip")
    pose[0, :N_POSITION] = joint_of(joints, "pelvis")
    pose[0, skeleton.dof("root_heading")] = np.arctan2(-across[0], across[1])
    for _ in range(_FITS):
        pose = np.clip(refine(skeleton, pose, joints[None]), *skeleton.limits.T)
    return pose[0]
