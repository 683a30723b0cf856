"""Fit of a whole video to 2-D joints: time per frame by the length of the clip, memory, and its oracle's time.

    python -m analysis.benchmarks.video_fit N_FRAMES N_CAMERAS

fits once, for the memory measurement. A generated walker goes round in a circle before one camera, or four, with joint
errors of 4 px at 30 Hz; a tenth of the joints is missing. Processor time of one thread, with one BLAS thread.
"""

import os
import sys
import time
from functools import partial

import numpy as np

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.measuring import fastest_s, peak_gb
from tests.oracles.smooth_poses import expansion
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.losses import Loss
from workbench.core.observations import Keypoints, Observed
from workbench.core.prior import RECORDED_SMOOTHNESS
from workbench.inference.least_squares.motion.smooth_fit import SmoothPoses, first_poses, fit_smooth, keypoint_problem
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.motion.synthetic.gait import average_subject, walker
from workbench.utils.arrays import FloatArray
from workbench.utils.parallel import single_blas_thread

SIGMA_PX, MISSING, RATE_HZ, LOSS = 4.0, 0.1, 30.0, Loss("geman_mcclure", 1.5)
PLACES = ((0.0, -9.0, 1.5), (9.0, 0.0, 2.0), (0.0, 9.0, 1.5), (-9.0, 0.0, 2.0))
BODY = person(from_height(1.75))
LENGTHS = (100, 400, 3000)
LONG = 9000


def scene(n_frames: int, n_cameras: int, seed: int = 0) -> tuple[list[Observed], FloatArray, FloatArray]:
    """Return the observations of n_frames frames, their times (T,) and the true poses (T, P)."""
    rng = np.random.default_rng(seed)
    motion = walker(average_subject(), path="circle", duration_s=n_frames / RATE_HZ + 1.0, rate_hz=RATE_HZ)
    poses = motion.poses[:n_frames]
    poses = poses - np.r_[poses[:, :2].mean(axis=0), np.zeros(poses.shape[1] - 2)]
    places = enumerate(PLACES[:n_cameras])
    cameras = [plain_camera(960, 720, 900.0, place, (0.0, 0.0, 1.0), f"camera{k}") for k, place in places]
    joint_positions, observations = joints(BODY.skeleton, poses), []
    for positions in joint_positions:
        views = []
        for camera in cameras:
            pixels = camera.project(positions) + SIGMA_PX * rng.standard_normal((len(positions), 2))
            visible = np.flatnonzero(rng.random(len(positions)) > MISSING)
            views.append(Keypoints(visible, np.column_stack([pixels[visible], np.ones(len(visible))]), camera))
        observations.append(Observed(np.empty((0, 3)), tuple(views)))
    return observations, np.arange(n_frames) / RATE_HZ, poses


def fit(observations: list[Observed], times_s: FloatArray) -> SmoothPoses:
    """Return the fit of all frames as with `inference=least_squares prior=linear`, from the joints alone."""
    problem = keypoint_problem(BODY.skeleton, observations, times_s, SIGMA_PX, LOSS, RECORDED_SMOOTHNESS)
    return fit_smooth(problem, observations, first_poses(BODY.skeleton, observations[0].keypoints, SIGMA_PX), 40)


def figures() -> list[Figure]:
    """Measure milliseconds a frame, memory, and one evaluation against that of residual functions."""
    measured = []
    with single_blas_thread():
        for n_cameras, bars in ((1, (4.0, 5.0, 5.0)), (4, (2.0, 2.0, 2.0))):
            for n_frames, bar in zip(LENGTHS, bars, strict=True):
                observations, times_s, poses = scene(n_frames, n_cameras)
                (seconds,) = fastest_s([partial(fit, observations, times_s)], 3, clock=time.thread_time)
                errors = joints(BODY.skeleton, fit(observations, times_s).poses) - joints(BODY.skeleton, poses)
                error = 1e3 * float(np.linalg.norm(errors - errors[:, :1], axis=2)[:, 1:].mean())
                measured.append(Figure(
                    f"video_fit_{n_frames}_{n_cameras}", 1e3 * seconds / n_frames, "ms a frame", bar, "lower",
                    f"{n_frames} frames, {n_cameras} cameras: root-aligned error {error:.0f} mm",
                ))  # fmt: skip
        measured.append(_against_residuals())
    return [*measured, _memory()]


def _against_residuals(n_frames: int = 100) -> Figure:
    observations, times_s, poses = scene(n_frames, 1)
    problem = keypoint_problem(BODY.skeleton, observations, times_s, SIGMA_PX, LOSS, RECORDED_SMOOTHNESS)
    residuals = [views_residual(BODY.skeleton, frame.keypoints, SIGMA_PX, np.inf) for frame in observations]
    numpy, compiled = partial(expansion, problem, residuals, poses), partial(problem.expand, poses.ravel())
    ours, theirs = fastest_s([compiled, numpy], 5, clock=time.thread_time)
    what = f"one evaluation of {n_frames} frames: {1e3 * theirs:.0f} ms by functions, {1e3 * ours:.2f} ms batched"
    return Figure("video_fit_vs_functions", theirs / ours, "× faster", 60.0, "higher", what)


def _memory() -> Figure:
    module, threads = "analysis.benchmarks.video_fit", dict(os.environ, OPENBLAS_NUM_THREADS="1")
    long, short = (peak_gb(["-m", module, str(n), "1"], threads) for n in (LONG, LENGTHS[0]))
    what = f"peak of {LONG} frames beyond that of {LENGTHS[0]}"
    return Figure("video_fit_memory_gb", long - short, "GB", 1.0, "lower", what)


if __name__ == "__main__":
    fit(*scene(int(sys.argv[1]), int(sys.argv[2]))[:2])
