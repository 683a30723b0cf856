"""A walker on a floor in calibrated cameras or as points, and the verdict on a run that tracks the walker."""

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import ANKLE_HEIGHT, from_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, Truth, View
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.evaluation.uncertainty.step_calibration import expected_errors
from workbench.evaluation.verdict.run_findings import RunInputs
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import verdict
from workbench.motion.sources import find_motion

HEIGHT_M, RATE_HZ, N = 1.7, 25.0, 60
BODY = person(from_height(HEIGHT_M))
SPACE = StateSpace.of({"root": (("root_x",), "m")})
SIDES = ["left", "right"]


@cache
def walk():
    """Return poses (N, 25) of a person who walks along x through the origin on the floor z = 0."""
    poses = find_motion("builtin", data=None, rate_hz=RATE_HZ).poses[:N].copy()
    places = joints(BODY.skeleton, poses)
    poses[:, :3] -= [*places[:, 0, :2].mean(axis=0), places[..., 2].min() - ANKLE_HEIGHT * HEIGHT_M]
    return poses


def cameras(n=4):
    """Return cameras 5 m from the origin, at a height of 1.4 m, that face (0, 0, 1)."""
    angles = np.radians([-110.0, -20.0, 100.0, -160.0])[:n]
    places = [(5.0 * np.cos(a), 5.0 * np.sin(a), 1.4) for a in angles]
    return tuple(plain_camera(1280, 960, 900.0, at, (0.0, 0.0, 1.0), f"c{k}") for k, at in enumerate(places))


@dataclass(frozen=True)
class Scene:
    """The inputs of a run, which a fault may change.

    cameras: the calibration. keypoints: (V, N, J, 3). poses: the estimate (N, 25). points: (N, K, 3) or None. truth_m:
    offset of the true joints from the estimate's, (N, 3), or None. depth_std_m: of the particles along the first
    camera's line of sight, beyond 0.01 of every pose parameter. expected_errors: whether the run states them.
    landmarks: (V, N, J, 3) of a detector, see `View`, or None.
    """

    cameras: tuple
    keypoints: np.ndarray
    poses: np.ndarray
    points: np.ndarray | None = None
    times_s: np.ndarray = field(default_factory=lambda: np.arange(N) / RATE_HZ)
    inputs: RunInputs = field(default_factory=lambda: RunInputs(height_m=HEIGHT_M, rate_hz=RATE_HZ))
    errors: dict = field(default_factory=dict)
    annotations: np.ndarray | None = None
    truth_m: np.ndarray | None = None
    inlier_fraction: float = 0.9
    cost_decrease: float = 0.0
    body: object = BODY
    depth_std_m: float = 0.0
    expected_errors: bool = False
    landmarks: np.ndarray | None = None

    def verdict(self):
        return verdict(self.measurements(), self.inputs)

    def measurements(self):
        collector = MeasurementCollector(self.body)
        rng, image = np.random.default_rng(1), np.zeros((2, 2), np.uint8)
        for t, pose in enumerate(self.poses):
            views = tuple(
                View(c, image, rows[t], None if self.landmarks is None else self.landmarks[v, t])
                for v, (c, rows) in enumerate(zip(self.cameras, self.keypoints, strict=True))
            )
            truth = None if self.annotations is None else Truth(annotations=self.annotations[t])
            if self.truth_m is not None:
                truth = Truth(joints=joints(self.body.skeleton, pose[None])[0] + self.truth_m[t])
            frame = Frame(t, float(self.times_s[t]), views, truth, None if self.points is None else self.points[t])
            poses = pose + 0.01 * rng.standard_normal((20, 25))
            if self.depth_std_m:
                poses[:, :3] += self.depth_std_m * np.outer(rng.standard_normal(20), self.cameras[0].rotation[2])
            diagnostics = {"inlier_fraction": self.inlier_fraction, "cost_decrease": self.cost_decrease}
            step = Step(frame, SPACE, poses[:, :1], poses, np.full(20, -np.log(20.0)), np.zeros(20, np.int64), pose,
                        pose, 20.0, np.nan, diagnostics=diagnostics)  # fmt: skip
            stated = expected_errors(step, self.body.skeleton) if self.expected_errors else {}
            collector.add(step, stated | {name: float(values[t]) for name, values in self.errors.items()})
        return collector.measurements()


def level(measured, kind, **inputs):
    """Return the level of the finding of a kind on a run, "" without a problem."""
    findings = verdict(measured, RunInputs(**inputs)).findings
    return next((each.level for each in findings if each.kind == kind), "")


def scene(n_cameras=4, sigma_px=2.0):
    """Return the scene of a walker without faults, with n cameras and a detector error."""
    rng, rig, places = np.random.default_rng(2), cameras(n_cameras), joints(BODY.skeleton, walk())
    keypoints = np.array([camera.project(places) for camera in rig]).reshape(n_cameras, N, 15, 2)
    keypoints = keypoints + sigma_px * rng.standard_normal(keypoints.shape)
    return Scene(rig, np.concatenate([keypoints, np.ones_like(keypoints[..., :1])], axis=-1), walk())


def with_landmarks(intact, poses=None, frames=slice(None)):
    """Return the scene with the world landmarks of a detector that sees the walker, in some frames other poses."""
    seen = walk().copy()
    if poses is not None:
        seen[frames] = poses[frames]
    places, landmarks = joints(BODY.skeleton, seen), np.empty((len(intact.cameras), N, 15, 3))
    for v, camera in enumerate(intact.cameras):
        rays = camera.directions(camera.undistorted(intact.keypoints[v, ..., :2].mean(axis=1)))
        for t, ray in enumerate(rays):
            landmarks[v, t] = (places[t] - places[t, 0]) @ camera.viewing_axes(ray).T
    return replace(intact, landmarks=landmarks)


def point_scene():
    """Return the same walker as points near the bones, without cameras."""
    rng, places = np.random.default_rng(3), joints(BODY.skeleton, walk())
    ends = [(places[:, a], places[:, b]) for a, b in BODY.skeleton.bones]
    bones = np.stack([a + s * (b - a) for a, b in ends for s in np.linspace(0.0, 1.0, 12)], axis=1)
    return replace(scene(0), points=bones + 0.03 * rng.standard_normal(bones.shape))


def moved(rig, factor):
    """Return cameras whose positions are in another unit."""
    return tuple(replace(camera, translation=factor * camera.translation) for camera in rig)


def y_up(camera):
    """Return the camera in a world with y up: its coordinates are x, z and −y of ours."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # ours from theirs
    return replace(camera, rotation=camera.rotation @ turn)
