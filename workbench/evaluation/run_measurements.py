"""Measurements of a run's frames and steps, collected for its verdict."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import View
from workbench.core.step import Step
from workbench.evaluation.multiview_consistency import LIMBS, height_px, keypoint_pixels, triangulate_views
from workbench.evaluation.step_calibration import LARGE_MM
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_MIN_JOINTS = 4
"""Keypoints of a view from which on it shows a person; a detector sees fewer in a chair."""
_MIN_SPEED_M_S = 0.3
"""Speed of the pelvis from which on a person walks; slow walking is twice as fast."""
_STRIDE_S = 0.5
"""Half the time over which the pelvis' velocity is a difference; twice this is about a stride."""
_STEP_S = 0.07
"""The same for an ankle, whose swing takes 0.4 s."""
_LONG_GAP_S = 0.5
"""Time between two frames above which the motion between them is no jump."""
_FEET = ("pelvis", "left_ankle", "right_ankle")
_ERRORS = ("mpjpe_abs_mm", "pa_mpjpe_mm", "mpjpe_px", "forearm_width_px")


@dataclass(frozen=True, eq=False)
class RunMeasurements:
    """Measurements of F frames and V cameras; NaN where a frame has none.

    frames: (F,) their numbers. times_s: (F,). cameras: V names.
    keypoint_error_px: (F, V) median distance of the estimate's joints from the view's keypoints, px of the source.
    person_height_px: (F, V) of the person in the keypoints.
    in_image, has_person: (F, V) whether the estimate lies in the view's image, and whether the view's keypoints show a
    person.
    ray_separation: (F,) by pair of cameras, see `triangulate_views`.
    triangulated_joints: (F, J, 3), m, from all cameras' keypoints.
    keypoint_motion: (F,) motion of the keypoints since the frame before, the median over joints and views in heights of
    the person.
    observed_joints: (J,) which joints any keypoint shows.
    errors: (F,) by name, see `step_errors`.
    annotation_height_px: (F,) height of the person in the annotations that errors are measured by.
    lengths_m: of the tracked body, by limb.
    inlier_fraction: (F,) fraction of the observations near the body.
    uncertain_groups: (F,) groups of joints whose expected error exceeds LARGE_MM.
    iterations: of a fit, 0 without one.
    pelvis_and_ankles: (F, 3, 3), m, of the estimate: pelvis, left and right ankle.
    """

    frames: IntArray
    times_s: FloatArray
    cameras: tuple[str, ...]
    keypoint_error_px: FloatArray
    person_height_px: FloatArray
    in_image: BoolArray
    has_person: BoolArray
    ray_separation: Mapping[tuple[str, str], FloatArray]
    triangulated_joints: FloatArray
    keypoint_motion: FloatArray
    observed_joints: BoolArray
    errors: Mapping[str, FloatArray]
    annotation_height_px: FloatArray
    lengths_m: Mapping[str, float]
    inlier_fraction: FloatArray
    uncertain_groups: tuple[tuple[str, ...], ...]
    iterations: float
    has_points: bool
    pelvis_and_ankles: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))

    @property
    def has_keypoints(self) -> bool:
        """Whether any view has keypoints."""
        return bool(self.observed_joints.any())


class MeasurementCollector:
    """Collects the measurements of a run's steps, in their order.

    scale: factor by which the source's images were resized.
    """

    def __init__(self, body: Body, scale: float = 1.0) -> None:
        self._body, self._scale = body, scale
        named = [name for name in JOINT_NAMES if name in body.skeleton.names]
        self._body_joints, self._named = list(map(body.skeleton.joint, named)), list(map(JOINT_NAMES.index, named))
        self._rows: list[dict[str, Any]] = []
        self._last: dict[str, FloatArray] = {}
        self._observed = np.zeros(len(JOINT_NAMES), dtype=bool)
        self._iterations, self._has_points = 0.0, False

    def add(self, step: Step, errors: Mapping[str, float]) -> None:
        """Add one step and its errors."""
        frame, skeleton = step.frame, self._body.skeleton
        separation, points = triangulate_views([view for view in frame.views if view.keypoints is not None])
        estimate = joints(skeleton, step.expected_pose[None])[0]
        has_feet = set(_FEET) <= set(skeleton.names)
        annotations = None if frame.truth is None else frame.truth.annotations
        groups = ("head", "arms", "legs", "root")
        views = {view.camera.name: self._view(view, estimate) for view in frame.views}
        self._rows.append(
            {
                "frame": frame.index, "time_s": frame.time_s, "joints": points, "separation": separation,
                "errors": errors, "inlier_fraction": float(step.diagnostics.get("inlier_fraction", np.nan)),
                "uncertain": tuple(each for each in groups if errors.get(f"expected_error_{each}_mm", 0.0) > LARGE_MM),
                "feet": estimate[list(map(skeleton.joint, _FEET))] if has_feet else np.full((3, 3), np.nan),
                "views": views, "motion": self._motion(frame.time_s, frame.views, views),
                "annotation_height_px": np.nan if annotations is None else height_px(annotations) / self._scale,
            }
        )  # fmt: skip
        self._iterations = max(self._iterations, float(step.diagnostics.get("iterations", 0.0)))
        self._has_points |= frame.points is not None and len(frame.points) > 0

    def _view(self, view: View, joints_m: FloatArray) -> tuple[float, float, bool, bool]:
        """Return keypoint_error_px, person_height_px, in_image and has_person of a view; joints_m: (J, 3),
        estimated."""
        camera = view.camera
        pixels = camera.project(joints_m)
        inside = (pixels >= 0.0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
        in_image = bool(inside.mean() > 0.5)
        if view.keypoints is None:
            return np.nan, np.nan, in_image, False
        keypoints = keypoint_pixels(view)
        observed = np.isfinite(keypoints[:, 0])
        self._observed |= observed
        residuals = np.linalg.norm(pixels[self._body_joints] - keypoints[self._named], axis=1)
        error_px = float(np.nanmedian(residuals)) / self._scale if np.isfinite(residuals).any() else np.nan
        return error_px, height_px(keypoints) / self._scale, in_image, int(observed.sum()) >= _MIN_JOINTS

    def _motion(
        self, time_s: float, views: tuple[View, ...], measured: Mapping[str, tuple[float, float, bool, bool]]
    ) -> float:
        """Return the motion of the keypoints since the frame before, whose keypoints are replaced; NaN after a gap."""
        if self._rows and time_s - self._rows[-1]["time_s"] > _LONG_GAP_S:
            self._last = {}
        last, self._last = self._last, {v.camera.name: keypoint_pixels(v) for v in views if v.keypoints is not None}
        steps = [
            np.linalg.norm(keypoints - last[name], axis=1) / (measured[name][1] * self._scale)
            for name, keypoints in self._last.items()
            if name in last and measured[name][1] > 0.0
        ]
        each = [float(np.nanmedian(step)) for step in steps if np.isfinite(step).any()]
        return float(np.median(each)) if each else np.nan

    def measurements(self) -> RunMeasurements:
        """Return the measurements of all steps so far."""
        rows, n = self._rows, len(self._rows)
        cameras = tuple(dict.fromkeys(name for row in rows for name in row["views"]))
        pairs = dict.fromkeys(pair for row in rows for pair in row["separation"])
        absent = (np.nan, np.nan, False, False)
        views = np.array([[row["views"].get(name, absent) for name in cameras] for row in rows], np.float64)
        views = views.reshape(n, len(cameras), 4)
        errors = [name for name in _ERRORS if any(name in row["errors"] for row in rows)]
        times_s, motion, annotation_heights, inlier_fraction = (
            np.array([row[name] for row in rows], np.float64)
            for name in ("time_s", "motion", "annotation_height_px", "inlier_fraction")
        )
        return RunMeasurements(
            frames=np.array([row["frame"] for row in rows], dtype=np.int64), times_s=times_s, cameras=cameras,
            keypoint_error_px=views[..., 0], person_height_px=views[..., 1], in_image=views[..., 2] == 1.0,
            has_person=views[..., 3] == 1.0,
            ray_separation={
                pair: np.array([row["separation"].get(pair, np.nan) for row in rows]) for pair in pairs
            },
            triangulated_joints=np.array([row["joints"] for row in rows]).reshape(n, len(JOINT_NAMES), 3),
            keypoint_motion=motion, observed_joints=self._observed,
            errors={name: np.array([row["errors"].get(name, np.nan) for row in rows]) for name in errors},
            annotation_height_px=annotation_heights,
            lengths_m={limb: float(getattr(self._body.shape, limb)) for limb in LIMBS}, inlier_fraction=inlier_fraction,
            uncertain_groups=tuple(row["uncertain"] for row in rows), iterations=self._iterations,
            has_points=self._has_points, pelvis_and_ankles=np.array([row["feet"] for row in rows]).reshape(n, 3, 3),
        )  # fmt: skip


def stance(pelvis: FloatArray, ankles: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the stance (F, 2) of both feet: 1 on the ground, 0 in swing, NaN without gait.

    A foot is in stance while its ankle moves backwards relative to the pelvis, and in swing while it moves forwards
    (Zeni, Richards, Higginson 2008, the coordinate-based treadmill and overground algorithm). NaN where the pelvis is
    slower than _MIN_SPEED_M_S, and for less than half a second of frames. In contrast to the paper, speeds are
    differences over twice _STEP_S instead of extrema of a filtered curve, and a runner's stance begins when the foot is
    drawn back.

    Parameters
    ----------
    pelvis : (F, 3), m.
    ankles : (F, 2, 3), m, left and right.
    times_s : (F,), s.
    """
    stances = np.full((len(times_s), 2), np.nan)
    if len(times_s) < 2 or times_s[-1] - times_s[0] < _STRIDE_S:
        return stances
    velocity = _velocity(pelvis[:, :2], times_s, _STRIDE_S)
    walks = np.linalg.norm(velocity, axis=1) >= _MIN_SPEED_M_S
    relative = _velocity((ankles - pelvis[:, None])[..., :2], times_s, _STEP_S)
    forwards = np.einsum("fsk,fk->fs", relative, velocity)
    stances[walks] = forwards[walks] < 0.0
    return np.where(np.isfinite(forwards), stances, np.nan)


def _velocity(positions: FloatArray, times_s: FloatArray, reach_s: float) -> FloatArray:
    """Return differences of positions (F, ...) over reach_s before and after, at least a frame, per second."""
    n = len(times_s)
    first: IntArray = np.minimum(np.searchsorted(times_s, times_s - reach_s), np.maximum(np.arange(n) - 1, 0))
    last = np.maximum(
        np.searchsorted(times_s, times_s + reach_s, side="right") - 1, np.minimum(np.arange(n) + 1, n - 1)
    )
    spans = (times_s[last] - times_s[first]).reshape(-1, *[1] * (positions.ndim - 1))
    return np.asarray((positions[last] - positions[first]) / spans)
