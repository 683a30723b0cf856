"""What a run's frames and steps show of its success, gathered frame by frame for `verdict`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import View
from workbench.core.step import Step
from workbench.evaluation.multiview_consistency import LIMBS, found_marks, height_px, meeting
from workbench.evaluation.step_calibration import LARGE_MM
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_MIN_JOINTS = 4
"""Joints of a view that make a person; fewer are what a detector sees in a chair."""
_SLOWEST_M_S = 0.3
"""Speed of a pelvis that goes somewhere; slow walking is twice as fast."""
_STRIDE_S = 0.5  # before and after a frame, in which a pelvis shows the way: together about a stride
_STEP_S = 0.07  # the same for an ankle, whose swing takes 0.4 s
_FEET = ("pelvis", "left_ankle", "right_ankle")
_ERRORS = ("error_abs_mm", "error_procrustes_mm", "error_px", "forearm_px")


@dataclass(frozen=True, eq=False)
class RunMeasurements:
    """Measurements of F frames; NaN where a frame has none.

    frames: (F,) their numbers. times_s: (F,). cameras: V names. off_px: (F, V) median distance of the estimate's joints
    from the view's keypoints, px of the source. height_px: (F, V) of the person in the keypoints. expected, found:
    (F, V) whether the estimate lies in the view's image, and whether the view has keypoints of a person. apart: by pair
    of cameras (F,), see `meeting`. joints: (F, J, 3), m, where the cameras' rays meet. moved: (F,) by how much the
    keypoints moved since the frame before, the median over joints and views in heights of the person. marked: (J,)
    which joints any keypoint shows. errors: (F,) by name, as `step_errors` has them. mark_height_px: (F,) of the person
    in the marks that errors are measured by. lengths_m: of the body tracked, by limb.
    inliers: (F,) share of the observations near the body. doubted: (F,) groups of joints whose stated error is larger
    than LARGE_MM. iterations: of a fit, 0 where there is none.
    feet: (F, 3, 3), m, of the estimate: pelvis, left and right ankle.
    """

    frames: IntArray
    times_s: FloatArray
    cameras: tuple[str, ...]
    off_px: FloatArray
    height_px: FloatArray
    expected: BoolArray
    found: BoolArray
    apart: Mapping[tuple[str, str], FloatArray]
    joints: FloatArray
    moved: FloatArray
    marked: BoolArray
    errors: Mapping[str, FloatArray]
    mark_height_px: FloatArray
    lengths_m: Mapping[str, float]
    inliers: FloatArray
    doubted: tuple[tuple[str, ...], ...]
    iterations: float
    has_points: bool
    feet: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))

    @property
    def has_keypoints(self) -> bool:
        """Whether any view shows joints."""
        return bool(self.marked.any())


class Evidence:
    """Gathers measurements of steps, in their order. scale: the factor by which the source's images were resized."""

    def __init__(self, body: Body, scale: float = 1.0) -> None:
        self._body, self._scale = body, scale
        named = [name for name in JOINT_NAMES if name in body.skeleton.names]
        self._own, self._named = list(map(body.skeleton.joint, named)), list(map(JOINT_NAMES.index, named))
        self._rows: list[dict[str, Any]] = []
        self._last: dict[str, FloatArray] = {}
        self._marked = np.zeros(len(JOINT_NAMES), dtype=bool)
        self._iterations, self._has_points = 0.0, False

    def add(self, step: Step, errors: Mapping[str, float]) -> None:
        """Add one step and its errors."""
        frame, skeleton = step.frame, self._body.skeleton
        apart, meeting_points = meeting([view for view in frame.views if view.keypoints is not None])
        estimate = joints(skeleton, step.expected_pose[None])[0]
        has_feet = set(_FEET) <= set(skeleton.names)
        marks = None if frame.truth is None else frame.truth.annotations
        groups = ("head", "arms", "legs", "root")
        views = {view.camera.name: self._view(view, estimate) for view in frame.views}
        self._rows.append(
            {
                "frame": frame.index, "time_s": frame.time_s, "joints": meeting_points, "apart": apart,
                "errors": errors, "inliers": float(step.diagnostics.get("inliers", np.nan)),
                "doubted": tuple(group for group in groups if errors.get(f"doubt_{group}_mm", 0.0) > LARGE_MM),
                "feet": estimate[list(map(skeleton.joint, _FEET))] if has_feet else np.full((3, 3), np.nan),
                "views": views, "moved": self._moved(frame.views, views),
                "mark_height_px": np.nan if marks is None else height_px(marks) / self._scale,
            }
        )  # fmt: skip
        self._iterations = max(self._iterations, float(step.diagnostics.get("iterations", 0.0)))
        self._has_points |= frame.points is not None and len(frame.points) > 0

    def _view(self, view: View, places: FloatArray) -> tuple[float, float, bool, bool]:
        """Compare a view with the estimate's joints (J, 3), m: off_px, height_px, expected, found."""
        camera = view.camera
        pixels = camera.project(places)
        inside = (pixels >= 0.0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
        expected = bool(inside.mean() > 0.5)
        if view.keypoints is None:
            return np.nan, np.nan, expected, False
        marks = found_marks(view)
        known = np.isfinite(marks[:, 0])
        self._marked |= known
        off = np.linalg.norm(pixels[self._own] - marks[self._named], axis=1)
        off_px = float(np.nanmedian(off)) / self._scale if np.isfinite(off).any() else np.nan
        return off_px, height_px(marks) / self._scale, expected, int(known.sum()) >= _MIN_JOINTS

    def _moved(self, views: tuple[View, ...], measured: Mapping[str, tuple[float, float, bool, bool]]) -> float:
        """Return the distance of the keypoints from those of the frame before, which are replaced."""
        last, self._last = self._last, {v.camera.name: found_marks(v) for v in views if v.keypoints is not None}
        steps = [
            np.linalg.norm(marks - last[name], axis=1) / (measured[name][1] * self._scale)
            for name, marks in self._last.items()
            if name in last and measured[name][1] > 0.0
        ]
        each = [float(np.nanmedian(step)) for step in steps if np.isfinite(step).any()]
        return float(np.median(each)) if each else np.nan

    def measured(self) -> RunMeasurements:
        """Return the measurements of all steps so far."""
        rows, n = self._rows, len(self._rows)
        cameras = tuple(dict.fromkeys(name for row in rows for name in row["views"]))
        pairs = dict.fromkeys(pair for row in rows for pair in row["apart"])
        unseen = (np.nan, np.nan, False, False)
        views = np.array([[row["views"].get(name, unseen) for name in cameras] for row in rows], np.float64)
        views = views.reshape(n, len(cameras), 4)
        errors = [name for name in _ERRORS if any(name in row["errors"] for row in rows)]
        times_s, moved, mark_heights, inliers = (
            np.array([row[name] for row in rows], np.float64)
            for name in ("time_s", "moved", "mark_height_px", "inliers")
        )
        return RunMeasurements(
            frames=np.array([row["frame"] for row in rows], dtype=np.int64), times_s=times_s, cameras=cameras,
            off_px=views[..., 0], height_px=views[..., 1], expected=views[..., 2] == 1.0, found=views[..., 3] == 1.0,
            apart={pair: np.array([row["apart"].get(pair, np.nan) for row in rows]) for pair in pairs},
            joints=np.array([row["joints"] for row in rows]).reshape(n, len(JOINT_NAMES), 3), moved=moved,
            marked=self._marked,
            errors={name: np.array([row["errors"].get(name, np.nan) for row in rows]) for name in errors},
            mark_height_px=mark_heights,
            lengths_m={limb: float(getattr(self._body.shape, limb)) for limb in LIMBS}, inliers=inliers,
            doubted=tuple(row["doubted"] for row in rows), iterations=self._iterations, has_points=self._has_points,
            feet=np.array([row["feet"] for row in rows]).reshape(n, 3, 3),
        )  # fmt: skip


def stance(pelvis: FloatArray, ankles: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return 1 where ankles (F, 2, 3), left and right, m, belong to standing feet, and 0 elsewhere, (F, 2).

    A foot stands while its ankle goes backwards as seen from the pelvis (F, 3), and swings while it goes forwards
    (Zeni, Richards, Higginson 2008, the coordinate-based treadmill and overground algorithm). NaN where the pelvis is
    slower than _SLOWEST_M_S, or where there is less than half a second. Unlike there, speeds are differences over
    twice _STEP_S instead of extrema of a filtered curve, and a runner's foot stands from the moment it is drawn back.
    """
    found = np.full((len(times_s), 2), np.nan)
    if len(times_s) < 2 or times_s[-1] - times_s[0] < _STRIDE_S:
        return found
    speed = _velocity(pelvis[:, :2], times_s, _STRIDE_S)
    pace = np.linalg.norm(speed, axis=1)
    goes = pace >= _SLOWEST_M_S
    ahead = _velocity((ankles - pelvis[:, None])[..., :2], times_s, _STEP_S)
    forwards = np.einsum("fsk,fk->fs", ahead, speed)
    found[goes] = forwards[goes] < 0.0
    return np.where(np.isfinite(forwards), found, np.nan)


def _velocity(places: FloatArray, times_s: FloatArray, reach_s: float) -> FloatArray:
    """Differences of places (F, ...) over reach_s before and after, at least a frame, per second."""
    n = len(times_s)
    first: IntArray = np.minimum(np.searchsorted(times_s, times_s - reach_s), np.maximum(np.arange(n) - 1, 0))
    last = np.maximum(
        np.searchsorted(times_s, times_s + reach_s, side="right") - 1, np.minimum(np.arange(n) + 1, n - 1)
    )
    spans = (times_s[last] - times_s[first]).reshape(-1, *[1] * (places.ndim - 1))
    return np.asarray((places[last] - places[first]) / spans)
