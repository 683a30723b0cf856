"""What frames show of a person that a fit can use: points of the surface, and 2-D joints in every view."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES, Skeleton
from workbench.body.surface import Kind
from workbench.core.frame import Frame
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Joints (M,) of the skeleton that `camera` saw at marks (M, 3), [u px, v px, weight above 0]; M ≥ 1."""

    joints: IntArray
    marks: FloatArray
    camera: Camera


@dataclass(frozen=True, eq=False)
class Observed:
    """What one frame shows. points: (K, 3), m. keypoints: one for every view that shows some."""

    points: FloatArray
    keypoints: tuple[Keypoints, ...] = ()


@dataclass(frozen=True)
class Observables:
    """What a likelihood looks at in a frame, and how exactly it takes that.

    sigma: standard deviation of a point's residual of this kind, m for "distance"; None where points do not matter.
    sigma_px: of a keypoint, px of the image used; None where keypoints do not matter. cameras: names of the cameras
    whose keypoints matter, None for all. common_bias_std_m: by how much points of one part of the body, and all, are
    off together, m.
    """

    sigma: float | None = None
    residual: Kind = "distance"
    sigma_px: float | None = None
    cameras: tuple[str, ...] | None = None
    common_bias_std_m: float = 0.0

    @property
    def kinds(self) -> tuple[str, ...]:
        """Name those of "points" and "keypoints" that matter."""
        return ("points",) * (self.sigma is not None) + ("keypoints",) * (self.sigma_px is not None)


EVERYTHING = Observables(sigma=1.0, sigma_px=1.0)


def observe(
    frames: Sequence[Frame], skeleton: Skeleton, most_points: int, rng: np.random.Generator,
    observables: Observables = EVERYTHING,
) -> tuple[list[Observed], list[tuple[str, ...]]]:  # fmt: skip
    """Pick what each frame shows of what matters, and warn of points left out or thinned, and of nothing seen.

    most_points: a frame's points beyond are thinned at random. observables: what matters. Raises InputError where they
    name a camera that no frame has.
    """
    cameras = dict.fromkeys(view.camera.name for frame in frames for view in frame.views)
    if unknown := set(observables.cameras or ()) - set(cameras):
        raise InputError(f"keypoints: cameras: no camera {min(unknown)!r}, expected some of {', '.join(cameras)}")
    no_points, seen, warnings = np.empty((0, 3)), [], list[list[str]]()
    for frame in frames:
        points, sentences = (no_points, []) if observables.sigma is None else _points(frame, most_points, rng)
        keypoints = () if observables.sigma_px is None else frame_keypoints(skeleton, frame, observables.cameras)
        seen.append(Observed(points, keypoints))
        warnings.append(sentences)
    for first, sentence in _gaps(frames, seen):
        warnings[first].append(sentence)
    return seen, [tuple(sentences) for sentences in warnings]


def kinds_seen(seen: Sequence[Observed]) -> tuple[str, ...]:
    """Name those of "points" and "keypoints" that some frame shows."""
    points, keypoints = any(len(frame.points) for frame in seen), any(frame.keypoints for frame in seen)
    return ("points",) * points + ("keypoints",) * keypoints


def usable_keypoints(skeleton: Skeleton, given: FloatArray, camera: Camera) -> Keypoints | None:
    """Pick those of keypoints (J, 3), in the order of JOINT_NAMES, that are finite and weighted; None if there is
    none."""
    rows = np.flatnonzero(np.isfinite(given).all(axis=1) & (np.nan_to_num(given[:, 2]) > 0.0))
    joints = np.array([skeleton.joint(JOINT_NAMES[row]) for row in rows], dtype=np.intp)
    return Keypoints(joints, given[rows], camera) if len(rows) else None


def frame_keypoints(skeleton: Skeleton, frame: Frame, cameras: Sequence[str] | None = None) -> tuple[Keypoints, ...]:
    """Pick the usable keypoints of every view that has some, of the cameras named by `cameras`, None for all."""
    usable = (
        usable_keypoints(skeleton, view.keypoints, view.camera)
        for view in frame.views
        if view.keypoints is not None and (cameras is None or view.camera.name in cameras)
    )
    return tuple(keypoints for keypoints in usable if keypoints is not None)


def person_px(seen: Sequence[Keypoints]) -> float:
    """Measure the person's height in the image, px: of the box around the joints, the median over the views (n ≥ 1)."""
    return float(np.median([np.ptp(keypoints.marks[:, 1]) for keypoints in seen]))


def _points(frame: Frame, most: int, rng: np.random.Generator) -> tuple[FloatArray, list[str]]:
    """Return the frame's usable points (K, 3), m, and what was done about the others."""
    given = np.empty((0, 3)) if frame.points is None else frame.points
    points, warnings = given[np.isfinite(given).all(axis=1)], []
    if len(points) < len(given):
        warnings.append(f"frame {frame.index}: {len(given) - len(points)} points are not finite; left out")
    if len(points) > most:
        warnings.append(f"frame {frame.index}: {len(points)} points thinned to {most}")
        points = points[np.sort(rng.choice(len(points), most, replace=False))]
    return points, warnings


def _gaps(frames: Sequence[Frame], seen: Sequence[Observed]) -> list[tuple[int, str]]:
    """Find where every run of frames that show nothing begins, and a sentence about it."""
    expected, gaps = " or ".join(kinds_seen(seen)), []
    for empty, run in groupby(range(len(seen)), key=lambda t: not len(seen[t].points) and not seen[t].keypoints):
        first, *others = run
        place, neighbours = f"frame {frames[first].index}", "it"
        if others:
            place, neighbours = f"frames {frames[first].index} to {frames[others[-1]].index}", "them"
        if empty:
            gaps.append((first, f"{place}: no {expected}; bridged by the frames beside {neighbours}"))
    return gaps
