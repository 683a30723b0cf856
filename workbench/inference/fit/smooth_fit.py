"""The problem of poses that move smoothly and stay within the body's limits, without a motion model."""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.skeleton import Skeleton
from workbench.core.motion_model import MotionModel
from workbench.core.observations import kinds_seen
from workbench.core.state_space import StateSpace
from workbench.core.traits import Traits, offering
from workbench.inference.fit.decoding import PoseDecoder
from workbench.inference.fit.first_guess import first_pose
from workbench.inference.fit.hypotheses import first_keypoints
from workbench.inference.fit.smooth import LEANING_SIGMA_RAD, first_poses, fit_smooth
from workbench.inference.fit.task import Fit, Task, fit_of


@dataclass(frozen=True)
class SmoothFit:
    """Fit smooth poses to all frames at once, see `smooth.fit_smooth`.

    ground_m: height of a standing person's ankles in the world, m, to which the lower foot is tied; None: to none.
    """

    traits: ClassVar[Traits] = offering()

    ground_m: float | None = None

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Name the pose's parameters."""
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Fit all frames at once; `start` as for `LeastSquares.run`."""
        clock = perf_counter()
        residuals = task.residuals(LEANING_SIGMA_RAD)
        poses, covariances, found = fit_smooth(
            task.skeleton, residuals, task.times_s, task.loss, _starts(task, start), task.smoothness,
            task.max_iterations, shown=[bool(kinds_seen([one])) for one in task.seen], camera=_only_camera(task),
            ground_m=self.ground_m,
        )  # fmt: skip
        decoder = PoseDecoder(task.skeleton)
        fit = fit_of(decoder, residuals, task.loss, poses, covariances, found.iterations, found.costs)
        return replace(fit, timing_s={"least_squares": perf_counter() - clock})


def _starts(task: Task, start: FloatArray | None) -> FloatArray:
    """Poses (n, P) of the first frame to start from."""
    if start is not None:
        return start[None]
    if keypoints := first_keypoints(task.seen):
        return first_poses(task.skeleton, keypoints, task.sigma_px)
    return first_pose(task, None)[None]


def _only_camera(task: Task) -> Camera | None:
    """The one that sees all there is; None where several do, or where there are points."""
    cameras = {one.camera.name: one.camera for frame in task.seen for one in frame.keypoints}
    return next(iter(cameras.values())) if len(cameras) == 1 and "points" not in kinds_seen(task.seen) else None
