"""Measurements of a run's frames and steps, collected for its verdict."""

from array import array
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.body.angles import N_POSITION
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS
from workbench.cameras.camera import Camera
from workbench.cameras.camera_motion import in_camera
from workbench.cameras.image_height import height_px
from workbench.cameras.observed_joints import ObservedJoints
from workbench.core.frame import Frame, View
from workbench.core.step import Step
from workbench.evaluation.errors.track_loss import UNCERTAIN_MM
from workbench.evaluation.uncertainty.step_calibration import GROUPS, expected_distances, expected_errors
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.nan_statistics import nan_median

_MIN_SPEED_M_S = 0.3
"""Speed of the pelvis from which on a person walks; slow walking is twice as fast."""
_STRIDE_S = 0.5
"""Half the time over which the pelvis' velocity is a difference; twice this is about a stride."""
_STEP_S = 0.07
"""The same for an ankle, whose swing takes 0.4 s."""
_FEET = [JOINT_NAMES.index(name) for name in ("pelvis", "left_ankle", "right_ankle")]


@dataclass(frozen=True, eq=False)
class RunMeasurements:
    """Measurements of F frames and V cameras; NaN where a frame has none.

    frames: (F,) their numbers. times_s: (F,). observed: the keypoints of all frames, and the cameras.
    keypoint_distances_px: (F, V, J) distances of the estimate's joints from the view's keypoints, px of the source.
    world_landmarks: (F, V, J, 3) of a detector along the world's axes, m, of an average person, see `View`.
    in_image: (F, V) whether the estimate lies in the view's image.
    errors: (F,) by name, of every metric that any frame has, see `Meter.errors`.
    annotation_distances_px: (F, J) distances of the estimate's joints from annotations that errors are measured by, px
        of the source. annotation_height_px: (F,) height of the person in them.
    joint_errors_m: (F, J) distances from true joints, relative to the root. expected_joint_errors_m: (F, J) the same by
        the posterior.
    lengths_m: of the tracked body, by limb.
    inlier_fraction: (F,) fraction of the observations near the body.
    uncertain_groups: (F,) groups of joints whose expected error exceeds UNCERTAIN_MM; with an only camera that is
        estimated, of their positions relative to the root, whose distance is uncertain with the focal length.
    cost_decrease: relative, in the last steps of a fit that used all its iterations; 0 for another.
    estimated_joints: (F, J, 3), m.
    depth_std_m: (F,) standard deviation of the pelvis' distance, where the only camera measures it.
    depth_error_m: (F,) mean error of the joints along the first camera's line of sight, by the true joints.
    point_extent_m: (F, 3) along x, y and z, of the middle 90 % of the points.
    """

    frames: IntArray
    times_s: FloatArray
    observed: ObservedJoints
    keypoint_distances_px: FloatArray
    world_landmarks: FloatArray
    in_image: BoolArray
    errors: Mapping[str, FloatArray]
    annotation_distances_px: FloatArray
    annotation_height_px: FloatArray
    joint_errors_m: FloatArray
    expected_joint_errors_m: FloatArray
    lengths_m: Mapping[str, float]
    inlier_fraction: FloatArray
    uncertain_groups: tuple[tuple[str, ...], ...]
    cost_decrease: float
    estimated_joints: FloatArray
    depth_std_m: FloatArray
    depth_error_m: FloatArray
    point_extent_m: FloatArray

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(camera.name for camera in self.observed.cameras)

    @property
    def keypoint_error_px(self) -> FloatArray:
        """Median over joints (F, V) of the distances from the keypoints, px of the source."""
        return nan_median(self.keypoint_distances_px, axis=2)

    @property
    def person_height_px(self) -> FloatArray:
        """Height (F, V) of the person in the keypoints, px of the source."""
        return self.observed.heights_px / self.observed.scale

    @property
    def has_truth(self) -> bool:
        """Whether the errors are those from true positions in space."""
        return "mpjpe_abs_mm" in self.errors

    @property
    def has_keypoints(self) -> bool:
        """Whether any view has keypoints."""
        return bool(np.isfinite(self.observed.pixels()).any())

    @property
    def observed_frames(self) -> BoolArray:
        """Which frames (F,) have keypoints of the person or points; all, in a run of images only."""
        observed = np.isfinite(self.point_extent_m).any(axis=1) | self.observed.shows_person.any(axis=1)
        return np.asarray(observed | (not self.has_keypoints and not self.has_points))

    @property
    def has_points(self) -> bool:
        """Whether any frame has points."""
        return bool(np.isfinite(self.point_extent_m).any())

    @property
    def pelvis_and_ankles(self) -> FloatArray:
        """Pelvis, left and right ankle (F, 3, 3), m, of the estimate."""
        return self.estimated_joints[:, _FEET]


class MeasurementCollector:
    """Collects the measurements of a run's steps, in their order, as numbers: long runs have many frames.

    scale: factor by which the source's images were resized.
    """

    def __init__(self, body: Body, scale: float = 1.0) -> None:
        self._body, self._scale = body.without_feet, scale
        skeleton = self._body.skeleton
        named = [name for name in JOINT_NAMES if name in skeleton.names]
        self._body_joints, self._named = list(map(skeleton.joint, named)), list(map(JOINT_NAMES.index, named))
        self._n = 0
        self._columns: defaultdict[tuple[str, str], array[float]] = defaultdict(lambda: array("d"))
        self._uncertain_groups: list[tuple[str, ...]] = []
        self._cameras: dict[str, Camera] = {}
        self._searched: set[str] = set()
        self._turns = False
        self._cost_decrease = 0.0

    def add(self, step: Step, errors: Mapping[str, float]) -> None:
        """Add one step and its errors."""
        step = step.first_parameters(len(self._body.skeleton.dof_names))
        frame = step.frame
        estimate = step.expected_joints(self._body.skeleton)
        places = np.full((len(JOINT_NAMES), 3), np.nan)
        places[self._named] = estimate[self._body_joints]
        annotations = None if frame.truth is None else frame.truth.annotations
        for view in frame.views:
            self._turns |= not self._cameras.setdefault(view.camera.name, view.camera).is_equal(view.camera)
        self._searched |= {view.camera.name for view in frame.views if view.keypoints is not None}
        points = None if frame.points is None or not len(frame.points) else frame.points
        expected = np.full(len(JOINT_NAMES), np.nan)
        if len(step.poses) > 1:
            expected[self._named] = expected_distances(step, self._body.skeleton, relative=True)[self._body_joints]
        uncertain = _uncertain(errors)
        if uncertain and len(frame.views) == 1 and frame.views[0].camera.uncertainty is not None:
            uncertain = _uncertain(expected_errors(step, self._body.skeleton, relative=True))
        if len(step.poses) == 1:  # no stated uncertainty
            errors = {name: value for name, value in errors.items() if not name.startswith("coverage_")}
        self._keep("frame", frame.index)
        self._keep("time_s", frame.time_s)
        for name, value in errors.items():
            self._keep("errors", value, name)
        self._keep("joints", places)
        for view in frame.views:
            self._add_view(view, places)
        self._keep("inlier_fraction", step.diagnostics.get("inlier_fraction", np.nan))
        if annotations is not None:
            self._keep("annotation_height_px", height_px(annotations) / self._scale)
            self._keep("annotation_distances_px", self._annotation_distances_px(frame, annotations, places))
        if frame.truth is not None and frame.truth.joints is not None:
            self._keep("joint_errors_m", self._joint_errors_m(frame.truth.joints, places))
        self._keep("expected_joint_errors_m", expected)
        self._keep("depth_std_m", _depth_std(step))
        self._keep("depth_error_m", _depth_error(step, estimate))
        if points is not None:
            self._keep("extent_m", np.ptp(np.percentile(points, [5.0, 95.0], axis=0), axis=0))
        self._uncertain_groups.append(uncertain)
        self._cost_decrease = max(self._cost_decrease, float(step.diagnostics.get("cost_decrease", 0.0)))
        self._n += 1

    def _add_view(self, view: View, places: FloatArray) -> None:
        """Keep the measurements of one view, with the estimate's joints (J, 3)."""
        name, pixels = view.camera.name, view.camera.project(places)
        self._keep("in_image", _in_image(view.camera, pixels), name)
        if view.keypoints is not None:
            self._keep("keypoints", view.keypoints, name)
            self._keep("in_cameras", self._in_first(view, view.keypoints), name)
            distances_px = np.linalg.norm(pixels - _keypoint_pixels(view.keypoints), axis=1)
            self._keep("distances_px", distances_px / self._scale, name)
            if view.world_landmarks is not None:
                self._keep("landmarks", _world_landmarks(view, view.keypoints, view.world_landmarks), name)

    def _keep(self, name: str, values: float | FloatArray, part: str = "") -> None:
        """Append a frame's numbers to a column, which is NaN in earlier frames without. part: a camera or an error."""
        numbers, column = np.asarray(values, np.float64), self._columns[name, part]
        if n_missing := self._n * numbers.size - len(column):
            column.extend([np.nan] * n_missing)
        column.frombytes(numbers.tobytes())

    def _column(self, name: str, *shape: int, part: str = "") -> FloatArray:
        """Return a column (n, *shape) of all frames so far."""
        values = np.full((self._n, *shape), np.nan)
        if (name, part) in self._columns:
            column = self._columns[name, part]
            values.reshape(-1)[: len(column)] = column
        return values

    def _in_first(self, view: View, keypoints: FloatArray) -> FloatArray:
        """Return a view's keypoints (J, 3) where the first frame's camera would see them."""
        first = self._cameras[view.camera.name]
        return np.column_stack([in_camera(keypoints[:, :2], view.camera, first), keypoints[:, 2]])

    def _annotation_distances_px(self, frame: Frame, annotations: FloatArray, places: FloatArray) -> FloatArray:
        """Return the distances (J,) of joints (J, 3) from visible annotations in the first view, px of the source."""
        if frame.truth is None or not frame.views:
            return np.full(len(places), np.nan)
        visible = True if frame.truth.annotations_visible is None else frame.truth.annotations_visible
        distances = np.linalg.norm(frame.views[0].camera.project(places) - annotations, axis=1)
        return np.where(visible, distances / self._scale, np.nan)

    def _joint_errors_m(self, true_joints: FloatArray, places: FloatArray) -> FloatArray:
        """Return the distances (J,), m, of joints (J, 3) from those of the true body, relative to the root."""
        true = np.full(places.shape, np.nan)
        true[self._named] = true_joints[self._body_joints]
        return np.asarray(np.linalg.norm((places - places[0]) - (true - true[0]), axis=1))

    def measurements(self) -> RunMeasurements:
        """Return the measurements of all steps so far."""
        n_joints, cameras, column = len(JOINT_NAMES), self._cameras, self._column

        def by_view(name: str, *shape: int, axis: int = 1) -> FloatArray:
            values = [column(name, *shape, part=camera) for camera in cameras]
            return np.stack(values, axis=axis) if values else np.empty((self._n, 0, *shape)).swapaxes(1, axis)

        searched = np.array([name in self._searched for name in cameras], bool)
        observed = ObservedJoints(
            tuple(cameras.values()), by_view("keypoints", n_joints, 3, axis=0), searched, times_s=column("time_s"),
            scale=self._scale, in_cameras=by_view("in_cameras", n_joints, 3, axis=0) if self._turns else None,
        )  # fmt: skip
        return RunMeasurements(
            frames=column("frame").astype(np.int64), times_s=column("time_s"),
            observed=observed, in_image=by_view("in_image") == 1.0,
            keypoint_distances_px=by_view("distances_px", n_joints), world_landmarks=by_view("landmarks", n_joints, 3),
            annotation_distances_px=column("annotation_distances_px", n_joints),
            joint_errors_m=column("joint_errors_m", n_joints),
            expected_joint_errors_m=column("expected_joint_errors_m", n_joints),
            errors={error: column(name, part=error) for name, error in self._columns if name == "errors"},
            annotation_height_px=column("annotation_height_px"),
            lengths_m={limb: float(getattr(self._body.shape, limb)) for limb in LIMBS},
            inlier_fraction=column("inlier_fraction"), uncertain_groups=tuple(self._uncertain_groups),
            cost_decrease=self._cost_decrease, estimated_joints=column("joints", n_joints, 3),
            depth_std_m=column("depth_std_m"), depth_error_m=column("depth_error_m"),
            point_extent_m=column("extent_m", 3),
        )  # fmt: skip


def _uncertain(errors: Mapping[str, float]) -> tuple[str, ...]:
    """Return the groups of joints whose expected error exceeds UNCERTAIN_MM."""
    return tuple(each for each in GROUPS if errors.get(f"expected_error_{each}_mm", 0.0) > UNCERTAIN_MM)


def _depth_std(step: Step) -> float:
    """Return the standard deviation, m, of the root's depth in the only camera; NaN for several, or one particle."""
    if len(step.frame.views) != 1 or len(step.poses) < 2:
        return float("nan")
    depths, weights = step.poses[:, :N_POSITION] @ step.frame.views[0].camera.rotation[2], np.exp(step.log_weights)
    mean = float(weights @ depths)
    return float(np.sqrt(weights @ (depths - mean) ** 2))


def _depth_error(step: Step, joints_m: FloatArray) -> float:
    """Return the mean error of joints (J, 3), m, along the first camera's line of sight, positive if too far away; NaN
    without a camera or true joints."""
    truth = step.frame.truth
    if not step.frame.views or truth is None or truth.joints is None:
        return float("nan")
    errors = (joints_m - truth.joints) @ step.frame.views[0].camera.rotation[2]
    return float(np.nanmean(errors)) if np.isfinite(errors).any() else float("nan")


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
    velocity = walking_velocity(pelvis, times_s)
    if not np.isfinite(velocity).any():
        return np.full((len(times_s), 2), np.nan)
    relative = _velocity((ankles - pelvis[:, None])[..., :2], times_s, _STEP_S)
    forwards = np.einsum("fsk,fk->fs", relative, velocity)
    return np.where(np.isfinite(forwards), forwards < 0.0, np.nan)


def _velocity(positions: FloatArray, times_s: FloatArray, reach_s: float) -> FloatArray:
    """Return differences of positions (F, ...) over reach_s before and after, at least a frame, per second."""
    n = len(times_s)
    first: IntArray = np.minimum(np.searchsorted(times_s, times_s - reach_s), np.maximum(np.arange(n) - 1, 0))
    last = np.maximum(
        np.searchsorted(times_s, times_s + reach_s, side="right") - 1, np.minimum(np.arange(n) + 1, n - 1)
    )
    spans = (times_s[last] - times_s[first]).reshape(-1, *[1] * (positions.ndim - 1))
    return np.asarray((positions[last] - positions[first]) / spans)


def walking_velocity(pelvis: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the horizontal velocity (F, 2), m/s, of a pelvis (F, 3), m; NaN while it is slower than a walk, in less
    than half a second of frames, and where times do not increase."""
    if len(times_s) < 2 or times_s[-1] - times_s[0] < _STRIDE_S or (np.diff(times_s) <= 0.0).any():
        return np.full((len(times_s), 2), np.nan)
    velocity = _velocity(pelvis[:, :2], times_s, _STRIDE_S)
    return np.where(np.linalg.norm(velocity, axis=1, keepdims=True) >= _MIN_SPEED_M_S, velocity, np.nan)


def foot_speeds(ankles: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the horizontal speeds (F, 2), m/s, of ankles (F, 2, 3), m."""
    return np.asarray(np.linalg.norm(_velocity(ankles, times_s, _STEP_S)[..., :2], axis=-1))


def _in_image(camera: Camera, pixels: FloatArray) -> bool:
    """Return whether more than half of the joints' pixels (J, 2) lie in a camera's image."""
    inside = (pixels >= 0.0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
    return bool(inside.mean() > 0.5)


def _world_landmarks(view: View, keypoints: FloatArray, landmarks: FloatArray) -> FloatArray:
    """Return a view's world landmarks (J, 3) along the world's axes, NaN without keypoints (J, 3)."""
    pixels = _keypoint_pixels(keypoints)
    pixels = pixels[np.isfinite(pixels[:, 0])]
    if not len(pixels):
        return np.full(landmarks.shape, np.nan)
    direction = view.camera.directions(view.camera.undistorted(pixels).mean(axis=0))
    return np.asarray(landmarks @ view.camera.viewing_axes(direction))


def _keypoint_pixels(keypoints: FloatArray) -> FloatArray:
    """Return the pixels (J, 2) of keypoints (J, 3), NaN where the weight is 0 or there is none."""
    return np.where(np.nan_to_num(keypoints[:, 2:]) > 0.0, keypoints[:, :2], np.nan)
