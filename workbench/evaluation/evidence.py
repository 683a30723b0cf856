"""What a run's frames and steps say of how well it went, gathered frame by frame for `verdict`."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import Frame, View
from workbench.core.step import Step
from workbench.evaluation.expected_error import LARGE_MM
from workbench.evaluation.multiview_consistency import LIMBS, found_marks, height_px, meeting
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

FOUND = 4
"""Joints of a view that make a person; fewer are what a detector sees in a chair."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What F frames came to; NaN for what a frame does not tell.

    frames: (F,) their numbers. times_s: (F,). cameras: V names. off_px: (F, V) median distance of the estimate's joints
    from the view's keypoints, px of the source. height_px: (F, V) of the person in the keypoints. expected, found:
    (F, V) whether the estimate lies in the view's image, and whether the view has keypoints of a person. apart: by pair
    of cameras (F,), see `Meeting`. joints: (F, J, 3), m, where the cameras' rays meet. moved: (F,) by how much the
    keypoints moved since the frame before, the median over joints and views in heights of the person. marked: (J,)
    which joints any keypoint shows. errors: (F,) by name, as `step_errors` has them. mark_height_px: (F,) of the person
    in the marks that errors are measured by. lengths_m: of the body tracked, by limb.
    doubted: (F,) groups of joints whose stated error is larger than LARGE_MM, see `doubt`.
    inliers: (F,) share of the observations near the body. iterations: of a fit, 0 where there is none.
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


_FEET = ("pelvis", "left_ankle", "right_ankle")
ERRORS = ("error_abs_mm", "error_procrustes_mm", "error_px", "forearm_px")


@dataclass(eq=False)
class _Row:
    """One frame's; by camera or by pair of cameras."""

    frame: int
    time_s: float
    joints: FloatArray
    errors: Mapping[str, float]
    inliers: float
    doubted: tuple[str, ...] = ()
    feet: FloatArray = field(default_factory=lambda: np.full((3, 3), np.nan))
    off_px: dict[str, float] = field(default_factory=dict)
    height_px: dict[str, float] = field(default_factory=dict)
    expected: dict[str, bool] = field(default_factory=dict)
    found: dict[str, bool] = field(default_factory=dict)
    apart: Mapping[tuple[str, str], float] = field(default_factory=dict)
    moved: float = np.nan
    mark_height_px: float = np.nan


class Evidence:
    """Gathers what steps say, in their order. scale: the factor by which the source's images were resized."""

    def __init__(self, body: Body, scale: float = 1.0) -> None:
        self._body, self._scale = body, scale
        self._named = [name for name in JOINT_NAMES if name in body.skeleton.names]
        self._rows: list[_Row] = []
        self._last: dict[str, FloatArray] = {}
        self._marked = np.zeros(len(JOINT_NAMES), dtype=bool)
        self._iterations, self._has_points = 0.0, False

    def add(self, step: Step, errors: Mapping[str, float]) -> None:
        """Take in one step and its errors."""
        frame = step.frame
        views = [view for view in frame.views if view.keypoints is not None]
        together = meeting(views)
        row = _Row(
            frame.index, frame.time_s, together.joints,
            {name: errors[name] for name in ERRORS if name in errors},
            float(step.diagnostics.get("inliers", np.nan)), _doubted(errors), apart=together.apart,
        )  # fmt: skip
        estimate = joints(self._body.skeleton, step.expected_pose[None])[0]
        if set(_FEET) <= set(self._body.skeleton.names):
            row.feet = estimate[[self._body.skeleton.joint(name) for name in _FEET]]
        for view in frame.views:
            self._look(row, view, estimate)
        row.moved = self._moved({view.camera.name: found_marks(view) for view in views}, row.height_px)
        row.mark_height_px = self._mark_height(frame)
        self._iterations = max(self._iterations, float(step.diagnostics.get("iterations", 0.0)))
        self._has_points |= frame.points is not None and len(frame.points) > 0
        self._rows.append(row)

    def _look(self, row: _Row, view: View, places: FloatArray) -> None:
        """Compare a view with the estimate's joints (J, 3), m; none of them may be one that keypoints name."""
        camera, name = view.camera, view.camera.name
        pixels = camera.project(places)
        inside = (pixels >= 0.0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
        row.expected[name] = bool(inside.mean() > 0.5)
        row.found[name] = False
        if view.keypoints is None:
            return
        marks = found_marks(view)
        known = np.isfinite(marks[:, 0])
        self._marked |= known
        row.found[name] = int(known.sum()) >= FOUND
        row.height_px[name] = height_px(marks) / self._scale
        own = [self._body.skeleton.joint(each) for each in self._named]
        off = np.linalg.norm(pixels[own] - marks[[JOINT_NAMES.index(each) for each in self._named]], axis=1)
        if np.isfinite(off).any():
            row.off_px[name] = float(np.nanmedian(off)) / self._scale

    def _moved(self, marks: dict[str, FloatArray], heights: Mapping[str, float]) -> float:
        """Measure how far the keypoints are from those of the frame before, and remember them."""
        last, self._last = self._last, marks
        steps = [
            np.linalg.norm(marks[name] - last[name], axis=1) / (heights[name] * self._scale)
            for name in marks
            if name in last and heights.get(name, 0.0) > 0.0
        ]
        each = [float(np.nanmedian(step)) for step in steps if np.isfinite(step).any()]
        return float(np.median(each)) if each else np.nan

    def _mark_height(self, frame: Frame) -> float:
        marks = None if frame.truth is None else frame.truth.marks
        return np.nan if marks is None else height_px(marks) / self._scale

    def measured(self) -> Measured:
        """Sum up what came in so far."""
        rows = self._rows
        cameras = tuple(dict.fromkeys(name for row in rows for name in row.expected))
        pairs = dict.fromkeys(pair for row in rows for pair in row.apart)
        shape = self._body.shape
        return Measured(
            frames=np.array([row.frame for row in rows], dtype=np.int64),
            times_s=np.array([row.time_s for row in rows]),
            cameras=cameras,
            off_px=_table([row.off_px for row in rows], cameras),
            height_px=_table([row.height_px for row in rows], cameras),
            expected=_table([row.expected for row in rows], cameras) == 1.0,
            found=_table([row.found for row in rows], cameras) == 1.0,
            apart={pair: np.array([row.apart.get(pair, np.nan) for row in rows]) for pair in pairs},
            joints=np.array([row.joints for row in rows]).reshape(len(rows), len(JOINT_NAMES), 3),
            moved=np.array([row.moved for row in rows]),
            marked=self._marked,
            errors={
                name: np.array([row.errors.get(name, np.nan) for row in rows])
                for name in ERRORS
                if any(name in row.errors for row in rows)
            },
            mark_height_px=np.array([row.mark_height_px for row in rows]),
            lengths_m={limb: float(getattr(shape, limb)) for limb in LIMBS},
            inliers=np.array([row.inliers for row in rows]),
            doubted=tuple(row.doubted for row in rows),
            iterations=self._iterations,
            has_points=self._has_points,
            feet=np.array([row.feet for row in rows]).reshape(len(rows), 3, 3),
        )


def _doubted(errors: Mapping[str, float]) -> tuple[str, ...]:
    """Name the groups of joints that are stated to be wrong by more than a person wants to be warned of."""
    groups = ("head", "arms", "legs", "root")
    return tuple(group for group in groups if errors.get(f"doubt_{group}_mm", 0.0) > LARGE_MM)


def _table(rows: list[dict[str, float]] | list[dict[str, bool]], columns: tuple[str, ...]) -> FloatArray:
    """Return (F, V) of rows by column, NaN for what a row does not have."""
    return np.array([[float(row.get(name, np.nan)) for name in columns] for row in rows]).reshape(len(rows), -1)
