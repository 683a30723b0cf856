"""Measures of simulated walks: their errors, and how often their 90 % intervals contain the truth.

Recorded walkers, from whom nothing is learned, are seen by one camera at random with the errors of a detector that were
measured (`fault_clips`), and are tracked as `workbench track` does. The truth is measured by the same rules on the
recorded motion.
"""

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from analysis.tables.fault_clips import NO_CALIBRATION, ONE, RATE_HZ, SIZE, Clip, generated, turned
from analysis.tables.faults import configured, one_thread
from analysis.tables.table import NONE, markdown
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import Shape
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.body.stature import SIDES
from workbench.cameras.camera import Camera, plain_camera
from workbench.evaluation.gait.estimates import bands_of
from workbench.evaluation.gait.joint_angles import joint_angles
from workbench.evaluation.gait.stretches import rows_of_stretches
from workbench.evaluation.gait.walk import Walk, walk_of
from workbench.experiment.tracking import assemble, track
from workbench.motion.sources import find_motion
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.nan_statistics import nan_mean
from workbench.utils.parallel import single_blas_thread
from workbench.utils.rng import stream

N_WALKS = 40
WALKS = ("02_01", "07_01", "08_01", "16_15", "35_01", "39_01")
"""Clips of six people in the CMU database."""
SETTINGS = (ONE, NO_CALIBRATION)
_SECONDS = 5.0
_FOCAL_PX, _MARGIN_PX = (500.0, 1000.0), 10.0
_SAME_STRIKE_S = 0.3
"""Largest difference of strikes that are compared: less than half a step."""
_HEADER = ("setting", "measure", "walks", "bias", "RMS error", "in the 90 % intervals (%)")
_NAMES = {
    "speed": ("speed (%)", 0), "cadence": ("cadence (%)", 1), "step_length": ("step length (cm)", 1),
    "knee_range": ("range of the knees (°)", 1), "strike": ("foot strikes (ms)", 0),
}  # fmt: skip
"""Titles and decimals of the measures."""
_RELATIVE = ("speed", "cadence")


@dataclass(frozen=True)
class Measured:
    """Errors of one walk's measures, in the units of _NAMES, by name, and whether the intervals contain the truth."""

    errors: Mapping[str, Sequence[float]]
    covered: Mapping[str, bool]


def table(data: Path | None, n_processes: int, n: int = N_WALKS) -> str:
    """Return the table of n walks in each setting, in Markdown; raises InputError without data.

    Parameters
    ----------
    data : recorded data, with the CMU database.
    n_processes : that track walks at once.
    """
    if data is None:
        raise InputError("needs recorded motion: --data FOLDER")
    lines = [[*_HEADER], ["---"] * len(_HEADER)]
    with ProcessPoolExecutor(n_processes, initializer=one_thread) as pool:
        for setting in SETTINGS:
            job = partial(measured, data=data, setting=setting)
            every = list(tqdm(pool.map(job, range(n)), desc=setting, total=n, disable=None))
            lines += _rows(setting, [each for each in every if each is not None], n)
    return markdown(lines)


def measured(number: int, data: Path, setting: str) -> Measured | None:
    """Return the errors of the measures of one walk; None where no walk is found."""
    clip, shape, poses = walk_clip(number, data)
    with tempfile.TemporaryDirectory() as folder:
        try:
            skeleton, rows, motions = motions_of(clip, Path(folder), setting)
        except InputError:
            return None
    estimate = walk(skeleton, motions, rows / RATE_HZ, clip.height_m)
    true = walk(person(shape).skeleton, poses[None, rows], rows / RATE_HZ, clip.height_m)
    if estimate is None or true is None:
        return None
    errors: dict[str, list[float]] = {"strike": strike_errors_ms(estimate, true)}
    covered = {}
    truths = values(true)
    for name, samples in values(estimate).items():
        (value, low, high), truth = (float(each[0]) for each in bands_of(samples[:, None])), float(truths[name][0])
        errors[name] = [100.0 * (value / truth - 1.0) if name in _RELATIVE else value - truth]
        if np.isfinite([value, truth]).all():
            covered[name] = low <= truth <= high
    return Measured(errors, covered)


def walk_clip(number: int, data: Path) -> tuple[Clip, Shape, FloatArray]:
    """Return the clip of a recorded walk before a camera at random, the person's shape, and the poses (F, P)."""
    rng = stream(number, "measures")
    motion = find_motion(WALKS[number % len(WALKS)], data=str(data), rate_hz=RATE_HZ)
    poses = turned(motion.poses[: int(_SECONDS * RATE_HZ)], rng.uniform(-np.pi, np.pi))
    poses[:, :2] -= 0.5 * (poses[:, :2].min(axis=0) + poses[:, :2].max(axis=0))
    camera = _camera(rng, joints(person(motion.shape).skeleton, poses))
    return generated(motion.shape, poses, number, (camera,)), motion.shape, poses


def _camera(rng: np.random.Generator, places: FloatArray) -> Camera:
    """Return a camera at random that has all joints (F, J, 3) in its image, as near as that is possible."""
    focal_px, height_m, azimuth = rng.uniform(*_FOCAL_PX), rng.uniform(0.8, 2.5), rng.uniform(-np.pi, np.pi)
    for away_m in np.arange(3.0, 20.0, 0.25):
        place = (float(away_m * np.cos(azimuth)), float(away_m * np.sin(azimuth)), height_m)
        camera = plain_camera(*SIZE, focal_px, place, (0.0, 0.0, 0.9), "cam0")
        pixels = camera.project(places)
        if (pixels > _MARGIN_PX).all() and (pixels < np.array(SIZE) - _MARGIN_PX).all():
            break
    return camera


def motions_of(clip: Clip, folder: Path, setting: str) -> tuple[Skeleton, FloatArray, FloatArray]:
    """Return the skeleton, the frames' numbers (F,) and the motions (1 + S, F, P) of a tracked clip: the expected one
    and samples of the posterior."""
    config = configured(clip, folder, setting)
    with single_blas_thread():
        components = assemble(config)
        steps = [step for step, _ in track(components, int(config.seed))]
    draws = [np.empty((0, len(step.expected_pose))) if step.draws is None else step.draws for step in steps]
    motions = np.stack([np.vstack([step.expected_pose, each]) for step, each in zip(steps, draws, strict=True)], axis=1)
    return components.body.skeleton, np.array([step.frame.index for step in steps]), motions


def walk(skeleton: Skeleton, motions: FloatArray, times_s: FloatArray, height_m: float) -> Walk | None:
    """Return the walk in motions (M, F, P)."""
    angles = joint_angles(skeleton.dof_names, motions)
    places = np.stack([joints(skeleton, each) for each in motions])
    stretches = rows_of_stretches(times_s, np.ones(len(times_s), dtype=bool))
    rotation = angles.names.index("torso_rotation")
    return walk_of(skeleton.names, places, angles.values, rotation, times_s, stretches, height_m)


def values(measured_walk: Walk) -> dict[str, FloatArray]:
    """Return the measures (M,) by name, in the units of the table, means over sides."""
    given = measured_walk.parameters
    names = joint_angles(POSE_NAMES, np.zeros((1, len(POSE_NAMES)))).names
    knees = [k for k, name in enumerate(names) if name == "knee_flexion"]
    ranges = [np.degrees(cycles.ranges[:, k]) for cycles, k in zip(measured_walk.cycles, knees, strict=True) if cycles]
    return {
        "speed": given["speed_m_s"]["both"], "cadence": given["cadence_steps_min"]["both"],
        "step_length": 100.0 * nan_mean(np.stack([given["step_length_m"][side] for side in SIDES], axis=1)),
        "knee_range": np.mean(ranges, axis=0),
    }  # fmt: skip


def strike_errors_ms(estimate: Walk, true: Walk) -> list[float]:
    """Return the errors, ms, of the strikes that both walks have."""
    errors = []
    for own, known in zip(estimate.strides, true.strides, strict=True):
        found, given = (np.unique(np.concatenate([each.starts_s[0], each.ends_s[0]])) for each in (own, known))
        for strike_s in given if len(found) else ():
            error_s = float(found[np.argmin(np.abs(found - strike_s))] - strike_s)
            if abs(error_s) < _SAME_STRIKE_S:
                errors.append(1e3 * error_s)
    return errors


def _rows(setting: str, every: Sequence[Measured], n: int) -> list[list[str]]:
    """Return the rows of a setting with n walks."""
    rows = []
    for name, (title, digits) in _NAMES.items():
        errors = np.array([error for each in every for error in each.errors[name]])
        covered = [each.covered[name] for each in every if name in each.covered]
        count = f"{len(every)} of {n}" + (f", {len(errors)} strikes" if name == "strike" else "")
        share = f"{100.0 * np.mean(covered):.0f}" if covered else NONE
        errors = errors[np.isfinite(errors)]  # a clip may show no whole step
        numbers = [f"{value:.{digits}f}" for value in (errors.mean(), np.sqrt(np.square(errors).mean()))]
        rows.append([setting, title, count, *numbers, share])
    return rows
