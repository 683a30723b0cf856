"""What frames show of a person that a fit can use: points of the surface, and 2-D joints in every view."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES, Skeleton
from workbench.body.surface import Kind, Surface
from workbench.datasets.frame import Frame
from workbench.inference.residuals import Residual, keypoint_residual, stacked, surface_residual, upright_residual

UPRIGHT_SIGMA_RAD = 0.15
"""Of people who walk or run."""


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

    def residual(
        self, skeleton: Skeleton, surface: Surface, kind: Kind, sigma: float, sigma_px: float,
        upright: float = UPRIGHT_SIGMA_RAD,
    ) -> Residual:  # fmt: skip
        """Of points, keypoints, both or nothing, whitened by their deviations sigma and sigma_px; upright: as below."""
        parts = [] if not len(self.points) else [surface_residual(skeleton, surface, self.points, kind, sigma)]
        parts += [views_residual(skeleton, self.keypoints, sigma_px, upright)] if self.keypoints else []
        return stacked(parts)


def person_px(seen: Sequence[Keypoints]) -> float:
    """The person's height in the image, px: of the box around the joints, the median over the views (n ≥ 1)."""
    return float(np.median([np.ptp(one.marks[:, 1]) for one in seen]))


def views_residual(
    skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float, upright: float = UPRIGHT_SIGMA_RAD
) -> Residual:
    """Of one frame's keypoints in all views, with a deviation of sigma_px over the root of the weight, and of a root
    that leans by `upright`, rad, see `upright_residual`."""
    views = [keypoint_residual(skeleton, one.camera, one.joints, one.marks, sigma_px) for one in seen]
    return stacked([*views, upright_residual(skeleton, upright)])


def usable_keypoints(skeleton: Skeleton, given: FloatArray, camera: Camera) -> Keypoints | None:
    """Those of keypoints (J, 3), in the order of JOINT_NAMES, that are finite and have a weight; None without any."""
    rows = np.flatnonzero(np.isfinite(given).all(axis=1) & (np.nan_to_num(given[:, 2]) > 0.0))
    found = np.array([skeleton.joint(JOINT_NAMES[row]) for row in rows], dtype=np.intp)
    return Keypoints(found, given[rows], camera) if len(rows) else None


def observe(
    frames: Sequence[Frame], skeleton: Skeleton, most_points: int, rng: np.random.Generator
) -> tuple[list[Observed], list[tuple[str, ...]]]:
    """What each frame shows, and what there is to say about it: points left out or thinned, and nothing to be seen.

    most_points: a frame's points beyond are thinned at random.
    """
    seen, warnings = [], []
    for frame in frames:
        points, said = _points(frame, most_points, rng)
        seen.append(Observed(points, _keypoints(frame, skeleton)))
        warnings.append(said)
    for first, sentence in _gaps(frames, seen):
        warnings[first].append(sentence)
    return seen, [tuple(said) for said in warnings]


def kinds_seen(seen: Sequence[Observed]) -> tuple[str, ...]:
    """Of "points" and "keypoints" those that some frame shows."""
    points, keypoints = any(len(one.points) for one in seen), any(one.keypoints for one in seen)
    return ("points",) * points + ("keypoints",) * keypoints


def _points(frame: Frame, most: int, rng: np.random.Generator) -> tuple[FloatArray, list[str]]:
    """The frame's usable points (K, 3), m, and what was done about the others."""
    given = np.empty((0, 3)) if frame.points is None else frame.points
    points, said = given[np.isfinite(given).all(axis=1)], []
    if len(points) < len(given):
        said.append(f"frame {frame.index}: {len(given) - len(points)} points are not finite; left out")
    if len(points) > most:
        said.append(f"frame {frame.index}: {len(points)} points thinned to {most}")
        points = points[np.sort(rng.choice(len(points), most, replace=False))]
    return points, said


def _keypoints(frame: Frame, skeleton: Skeleton) -> tuple[Keypoints, ...]:
    looked = [(view.keypoints, view.camera) for view in frame.views if view.keypoints is not None]
    found = [usable_keypoints(skeleton, given, camera) for given, camera in looked]
    return tuple(one for one in found if one is not None)


def _gaps(frames: Sequence[Frame], seen: Sequence[Observed]) -> list[tuple[int, str]]:
    """Where every run of frames that show nothing begins, and a sentence about it."""
    expected, gaps = " or ".join(kinds_seen(seen)), []
    for empty, run in groupby(range(len(seen)), key=lambda t: not len(seen[t].points) and not seen[t].keypoints):
        first, *others = run
        if empty and others:
            place = f"frames {frames[first].index} to {frames[others[-1]].index}"
            gaps.append((first, f"{place}: no {expected}; bridged by the frames beside them"))
        elif empty:
            gaps.append((first, f"frame {frames[first].index}: no {expected}; bridged by the frames beside it"))
    return gaps
