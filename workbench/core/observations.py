"""Observations used by least squares: points of the surface, and 2-D keypoints of every view."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES, Skeleton
from workbench.body.surface import SHARPNESS, Kind
from workbench.cameras.camera import Camera
from workbench.cameras.image_height import height_px
from workbench.core.frame import Frame
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Detected keypoints of one view: joints (M,) of the skeleton and their detections (M, 3), M ≥ 1, [u px, v px,
    weight above 0]. world_landmarks: (M, 3), m, see `View`; None without."""

    joints: IntArray
    detections: FloatArray
    camera: Camera
    world_landmarks: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Observed:
    """The observations of one frame. points: (K, 3), m. keypoints: one entry per view that has any."""

    points: FloatArray
    keypoints: tuple[Keypoints, ...] = ()


@dataclass(frozen=True)
class Observables:
    """The observations that a likelihood uses, and their standard deviations. sigma: of a point's residual, m for
    "distance"; None if points are not used. residual, sharpness: of points and of their surface. sigma_px: of a
    keypoint, px of the image used; None if keypoints are not used. cameras: names of the cameras whose keypoints are
    used; None for all. common_bias_std_m: standard deviation of the bias shared by all points, and by the points of one
    body part, m. systematic_errors: whether the errors of keypoints are those of a detector, which do not average out.
    depth_sigma_m: of the depth of a bone by a single camera's world landmarks, m; None if they are not used."""

    sigma: float | None = None
    residual: Kind = "distance"
    sharpness: float = SHARPNESS
    sigma_px: float | None = None
    cameras: tuple[str, ...] | None = None
    common_bias_std_m: float = 0.0
    systematic_errors: bool = False
    depth_sigma_m: float | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return those of "points" and "keypoints" that are used."""
        return ("points",) * (self.sigma is not None) + ("keypoints",) * (self.sigma_px is not None)


EVERYTHING = Observables(sigma=1.0, sigma_px=1.0)


def observe(
    frames: Sequence[Frame], skeleton: Skeleton, max_points: int, rng: np.random.Generator,
    observables: Observables = EVERYTHING,
) -> tuple[list[Observed], list[tuple[str, ...]]]:  # fmt: skip
    """Return the observations of every frame, and warnings about omitted or subsampled points and frames without any.

    Parameters
    ----------
    frames, skeleton : the sequence and the body's skeleton.
    max_points : points of a frame are subsampled at random to this number.
    rng : for the subsampling.
    observables : the observations used.

    Raises
    ------
    InputError : `observables` names a camera that no frame has.
    """
    cameras = dict.fromkeys(view.camera.name for frame in frames for view in frame.views)
    if unknown := set(observables.cameras or ()) - set(cameras):
        raise InputError(f"keypoints: cameras: unknown camera {min(unknown)!r}; expected some of {', '.join(cameras)}")
    no_points, observed, warnings = np.empty((0, 3)), [], list[list[str]]()
    for frame in frames:
        points, messages = (no_points, []) if observables.sigma is None else _points(frame, max_points, rng)
        keypoints = () if observables.sigma_px is None else frame_keypoints(skeleton, frame, observables.cameras)
        observed.append(Observed(points, keypoints))
        warnings.append(messages)
    for first, message in _gaps(frames, observed):
        warnings[first].append(message)
    return observed, [tuple(messages) for messages in warnings]


def observed_kinds(observed: Sequence[Observed]) -> tuple[str, ...]:
    """Name those of "points" and "keypoints" that some frame shows."""
    points, keypoints = any(len(frame.points) for frame in observed), any(frame.keypoints for frame in observed)
    return ("points",) * points + ("keypoints",) * keypoints


def usable_keypoints(
    skeleton: Skeleton, keypoints: FloatArray, camera: Camera, world_landmarks: FloatArray | None = None,
    feet: FloatArray | None = None,
) -> Keypoints | None:  # fmt: skip
    """Return the finite keypoints with positive weight among (J, 3), in the order of JOINT_NAMES, and among those of
    the feet (4, 3) where the skeleton has them, with their world landmarks of (J, 3), NaN for feet; None if there are
    none."""
    names, world = JOINT_NAMES, world_landmarks
    if feet is not None and set(FOOT_POINTS) <= set(skeleton.names):
        names, keypoints = (*names, *FOOT_POINTS), np.concatenate([keypoints, feet])
        world = None if world is None else np.pad(world, ((0, len(feet)), (0, 0)), constant_values=np.nan)
    rows = np.flatnonzero(np.isfinite(keypoints).all(axis=1) & (np.nan_to_num(keypoints[:, 2]) > 0.0))
    joints = np.array([skeleton.joint(names[row]) for row in rows], dtype=np.intp)
    return Keypoints(joints, keypoints[rows], camera, None if world is None else world[rows]) if len(rows) else None


def frame_keypoints(skeleton: Skeleton, frame: Frame, cameras: Sequence[str] | None = None) -> tuple[Keypoints, ...]:
    """Return the usable keypoints of every view that has any, of the named cameras; None for all cameras."""
    usable = (
        usable_keypoints(skeleton, view.keypoints, view.camera, view.world_landmarks, view.feet)
        for view in frame.views
        if view.keypoints is not None and (cameras is None or view.camera.name in cameras)
    )
    return tuple(keypoints for keypoints in usable if keypoints is not None)


def person_px(observed: Sequence[Keypoints]) -> float:
    """Return the person's height in the image, px, the median over n ≥ 1 views of `height_px`."""
    return float(np.median([height_px(keypoints.detections[:, :2]) for keypoints in observed]))


def _points(frame: Frame, max_points: int, rng: np.random.Generator) -> tuple[FloatArray, list[str]]:
    """Return the frame's usable points (K, 3), m, and warnings about the others."""
    candidates = np.empty((0, 3)) if frame.points is None else frame.points
    points, warnings = candidates[np.isfinite(candidates).all(axis=1)], []
    if len(points) < len(candidates):
        warnings.append(f"frame {frame.index}: {len(candidates) - len(points)} points are not finite; omitted")
    if len(points) > max_points:
        warnings.append(f"frame {frame.index}: {len(points)} points, subsampled to {max_points}")
        points = points[np.sort(rng.choice(len(points), max_points, replace=False))]
    return points, warnings


def _gaps(frames: Sequence[Frame], observed: Sequence[Observed]) -> list[tuple[int, str]]:
    """Return the first index of every run of frames without observations, and a warning about the run."""
    expected, gaps = " or ".join(observed_kinds(observed)), []
    for empty, run in groupby(
        range(len(observed)), key=lambda t: not len(observed[t].points) and not observed[t].keypoints
    ):
        first, *others = run
        place, neighbours = f"frame {frames[first].index}", "it"
        if others:
            place, neighbours = f"frames {frames[first].index} to {frames[others[-1]].index}", "them"
        if empty:
            gaps.append((first, f"{place}: no {expected}; interpolated from the frames next to {neighbours}"))
    return gaps
