"""Planted faults: what the verdict says of recordings with one fault each, and of faultless ones.

The runs are those of `workbench track` with generated or recorded detections, in files that its readers read. A verdict
is wrong where it is "trustworthy" although the result is materially worse than that of the clip without the fault, see
`is_worse`. A refusal in a sentence is right, except for outliers.
"""

import itertools
import logging
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import cv2
import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from analysis.figures.unrecorded import composed
from analysis.tables import fault_clips
from analysis.tables.fault_clips import (
    NO_CALIBRATION,
    SETTINGS,
    SEVERAL,
    SUBJECTS,
    Clip,
    exercise,
    run,
    walk,
    walk_of_height,
)
from analysis.tables.fault_kinds import FAULTS, OTHER_SIDE, faulty
from analysis.tables.table import NONE, markdown
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.evaluation.verdict.run_findings import RunInputs
from workbench.evaluation.verdict.run_measurements import MeasurementCollector, RunMeasurements
from workbench.evaluation.verdict.run_verdict import verdict
from workbench.experiment.run import run_inputs
from workbench.experiment.tracking import assemble, track
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.finding import TRUSTWORTHY
from workbench.utils.parallel import single_blas_thread

log = logging.getLogger(__name__)

REFUSED, FAILED = "refused", "failed"
"""Levels of clips without a run, besides those of a verdict."""
_WORSE_M, _WORSE_FACTOR = 0.03, 1.5
"""A mean distance is materially worse if it is by at least this more: the standard deviation of a joint's definition,
which detectors and people do not agree about; and at least this many times as large."""
_WORSE_FACING = 0.1
"""Fraction of the frames by which more face the wrong side."""
_WORSE_SPEED = 0.25
"""Difference of the factor by which joints move too fast: twice the difference of a fast and a normal walk."""
_WORSE_COVERAGE = 0.8
"""Factor of the number of frames of the clip with an estimate."""
_SPEED_FRAMES = 5
_HEADER = ("fault", "subject", "setting", "verdict", "sentence", "pose (mm)", "place (mm)", "speed (factor)", "right")


@dataclass(frozen=True, eq=False)
class Tracked:
    """A run without recording. measured, inputs : of the verdict. rows : (F,) of the clip's frames. joints : (F, J, 3),
    m. camera : the first one of the first frame."""

    measured: RunMeasurements
    inputs: RunInputs
    rows: IntArray
    joints: FloatArray
    camera: Camera


@dataclass(frozen=True)
class Errors:
    """Errors of a result against the truth.

    pose_m : mean over frames and joints of the distance relative to the pelvis. place_m : mean distance of all joints
    in the world; NaN without a calibration. facing : fraction of the frames whose hips face the other side. speed :
    factor of the velocities, least squares. covered : fraction of the clip's frames with an estimate.
    """

    pose_m: float
    place_m: float
    facing: float
    speed: float
    covered: float


@dataclass(frozen=True)
class Job:
    """A clip to be tracked. fault : "" for none. clean : name of a clip of CLEAN; "" for one of a subject."""

    subject: str
    setting: str
    fault: str = ""
    clean: str = ""


@dataclass(frozen=True)
class Outcome:
    """What becomes of a clip. level : of the verdict, or REFUSED or FAILED. errors : None without a result."""

    job: Job
    level: str
    sentence: str
    errors: Errors | None


CLEAN: Mapping[str, partial[Clip]] = {
    **{f"walk, noise {seed}": partial(walk, seed) for seed in range(4)},
    "slow walk": partial(walk, 6, slow=0.55),
    "fast walk": partial(walk, 7, slow=1.2),
    "oblique walk": partial(walk, 8, heading=0.9),
    "walk towards the camera": partial(walk, 9, heading=-1.4),
    "child": partial(walk_of_height, 1.2, 3),
    "height 1.55 m": partial(walk_of_height, 1.55, 4),
    "height 2.0 m": partial(walk_of_height, 2.0, 5),
    "long forearms": partial(walk, 10, forearm=0.32),
    "run": partial(run, 0),
    "squats": partial(exercise, 0, 0.6, hip_flexion=(0.0, 1.6), knee_flexion=(0.0, 1.9), root_pitch=(0.0, 0.5),
                      shoulder_flexion=(0.1, 1.3)),
    "sitting": partial(exercise, 1, 0.8, hip_flexion=(1.5, 1.5), knee_flexion=(1.5, 1.5), elbow_flexion=(0.3, 1.2)),
    "standing": partial(exercise, 2, -1.2, root_roll=(-0.02, 0.02), elbow_flexion=(0.2, 0.3)),
    "raised arms": partial(exercise, 3, -1.0, shoulder_abduction=(0.1, 2.6), elbow_flexion=(0.1, 0.4)),
}  # fmt: skip
"""Clips without a fault, besides those of the subjects."""


def table(data: Path | None, n_processes: int) -> str:
    """Return the table of all faults and of the clips without one, with the totals below it, in Markdown.

    Parameters
    ----------
    data : recorded data, for the balancing man; None: without him.
    n_processes : that track clips at once.
    """
    every = list(jobs(data))
    with ProcessPoolExecutor(n_processes, initializer=one_thread) as pool:
        outcomes = list(tqdm(pool.map(partial(outcome, data=data), every), total=len(every), disable=None))
    return text(outcomes)


def one_thread() -> None:
    """Use one thread, as there is a process for every core."""
    numba.set_num_threads(1)
    cv2.setNumThreads(1)


def jobs(data: Path | None) -> Iterator[Job]:
    """Yield the clips without a fault, then those with one."""
    for name, setting in itertools.product(SUBJECTS, SETTINGS):
        if data is not None or name != fault_clips.MAN:
            yield Job(name, setting)
    for name, setting in itertools.product(CLEAN, SETTINGS):
        yield Job(name, setting, clean=name)
    for (fault, kind), name, setting in itertools.product(FAULTS.items(), SUBJECTS, SETTINGS):
        if setting in kind.settings and (data is not None or name != fault_clips.MAN):
            yield Job(name, setting, fault)


def outcome(job: Job, data: Path | None) -> Outcome:
    """Write a clip's files, track, and compare with the truth."""
    clip = (CLEAN[job.clean]() if job.clean else fault_clips.subject(job.subject, data)).of_setting(job.setting)
    clip = faulty(clip, job.fault) if job.fault else clip
    with tempfile.TemporaryDirectory() as folder:
        try:
            result = tracked(clip, Path(folder), job.setting)
        except InputError as error:
            return Outcome(job, REFUSED, str(error).replace(f"{folder}/", ""), None)
        except Exception as error:  # any other is a defect, which the table is to show
            log.exception("%s", job)
            return Outcome(job, FAILED, f"{type(error).__name__}: {error}", None)
    judged = verdict(result.measured, result.inputs)
    return Outcome(job, judged.level, judged.message, least_errors(clip, result, job))


def tracked(clip: Clip, folder: Path, setting: str) -> Tracked:
    """Track the person of a clip as `workbench track` does, from files in an empty folder; InputError likewise."""
    config = configured(clip, folder, setting)
    with single_blas_thread():
        components = assemble(config)
        collector = MeasurementCollector(components.body, components.clip.info.scale)
        rows, places, camera = [], [], None
        for step, errors in track(components, int(config.seed)):
            collector.add(step, errors)
            skeleton = components.body.skeleton
            places.append(step.expected_joints(skeleton)[[skeleton.joint(name) for name in JOINT_NAMES]])
            rows.append(step.frame.index)
            camera = camera or step.frame.views[0].camera
    assert camera is not None
    settings = OmegaConf.to_container(config, resolve=True)
    inputs = run_inputs(config, settings, components)  # type: ignore[arg-type]
    return Tracked(collector.measurements(), inputs, np.array(rows), np.array(places), camera)


def configured(clip: Clip, folder: Path, setting: str) -> DictConfig:
    """Return the resolved configuration that tracks a clip, whose files are written into an empty folder."""
    config = _experiment(setting).copy()
    for key, value in fault_clips.write(clip, folder, setting).items():
        OmegaConf.update(config, key, value, merge=False)
    OmegaConf.resolve(config)
    return config


@cache
def _experiment(setting: str) -> DictConfig:
    """Return the configuration of a setting without its files; composing it takes as long as a fit."""
    return composed(["experiment=video", "paths.data=null", *(["dataset=multi_view"] if setting == SEVERAL else [])])


def least_errors(clip: Clip, result: Tracked, job: Job) -> Errors:
    """Return the errors of a result, the smaller ones of the truth and its mirror image where that is as right."""
    errors = compared(clip, result, job.setting)
    if not job.fault or not FAULTS[job.fault].mirrors or job.setting == SEVERAL:
        return errors
    camera = clip.true_cameras[0]
    seen = camera.to_camera(clip.truth[:, OTHER_SIDE]) * [-1.0, 1.0, 1.0]
    mirrored = replace(clip, truth=(seen - camera.translation) @ camera.rotation)
    return min(errors, compared(mirrored, result, job.setting), key=lambda each: each.pose_m)


def compared(clip: Clip, result: Tracked, setting: str) -> Errors:
    """Return the errors of a result: in the world, or without a calibration, along the camera's axes and in the
    person's own unit of length, which a single camera cannot show."""
    inside = result.rows < len(clip.times)
    rows, estimate = result.rows[inside], result.joints[inside]
    numbers = clip.times[rows]
    truth, place_m = clip.truth[numbers], np.nan
    if setting == NO_CALIBRATION:
        truth, estimate = clip.true_cameras[0].to_camera(truth), result.camera.to_camera(estimate)
    else:
        place_m = _mean(np.linalg.norm(estimate - truth, axis=2))
    truth, estimate = truth - truth[:, :1], estimate - estimate[:, :1]
    known = np.isfinite(truth)
    if setting == NO_CALIBRATION:
        estimate = estimate * (truth[known] @ estimate[known] / np.maximum(np.square(estimate[known]).sum(), 1e-9))
    facing = [_across(each, clip.true_cameras[0], setting) for each in (estimate, truth)]
    speed = _speed(truth, estimate, rows / clip.rate_hz, numbers / clip.true_rate_hz)
    return Errors(
        _mean(np.linalg.norm(estimate - truth, axis=2)), place_m,
        float(np.mean((facing[0] * facing[1]).sum(axis=1) < 0.0)), speed, len(rows) / len(clip.truth),
    )  # fmt: skip


def _mean(values: FloatArray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _across(places: FloatArray, camera: Camera, setting: str) -> FloatArray:
    """Return the horizontal directions (F, 3) from the right to the left hip of joints (F, J, 3)."""
    across = places[:, JOINT_NAMES.index("left_hip")] - places[:, JOINT_NAMES.index("right_hip")]
    up = camera.rotation[:, 2] if setting == NO_CALIBRATION else np.array([0.0, 0.0, 1.0])
    return np.asarray(across - (across @ up)[:, None] * up)


def _speed(truth: FloatArray, estimate: FloatArray, times_s: FloatArray, true_s: FloatArray) -> float:
    """Return the factor of the estimate's velocities that fits the true ones best, of joints (F, J, 3) at times (F,); 1
    where the true person does not move."""
    step = slice(_SPEED_FRAMES, None), slice(None, -_SPEED_FRAMES)
    if len(times_s) <= _SPEED_FRAMES:
        return 1.0
    true_step_s = (true_s[step[0]] - true_s[step[1]])[:, None, None]
    moved = np.broadcast_to(true_step_s != 0.0, truth[step[0]].shape)
    true = (truth[step[0]] - truth[step[1]]) / np.where(true_step_s == 0.0, 1.0, true_step_s)
    velocity = (estimate[step[0]] - estimate[step[1]]) / (times_s[step[0]] - times_s[step[1]])[:, None, None]
    known = np.isfinite(true) & np.isfinite(velocity) & moved
    return float((velocity[known] @ true[known]) / np.maximum(np.square(true[known]).sum(), 1e-9))


def is_worse(errors: Errors, clean: Errors) -> bool:
    """Return whether a result is materially worse than that of the clip without the fault."""
    pairs = (errors.pose_m, clean.pose_m), (errors.place_m, clean.place_m)
    farther = any(each - before > _WORSE_M and each > _WORSE_FACTOR * before for each, before in pairs)
    return (
        farther or errors.facing - clean.facing > _WORSE_FACING or abs(errors.speed - clean.speed) > _WORSE_SPEED
        or errors.covered < _WORSE_COVERAGE * clean.covered
    )  # fmt: skip


def is_right(each: Outcome, clean: Outcome) -> bool:
    """Return whether the verdict on a clip with a fault is right; clean : without the fault."""
    if each.level == REFUSED:
        return not FAULTS[each.job.fault].survives
    if each.level != TRUSTWORTHY or each.errors is None:
        return each.level != FAILED
    return clean.errors is None or not is_worse(each.errors, clean.errors)


def text(outcomes: Sequence[Outcome]) -> str:
    """Return the totals and the table of outcomes, in Markdown."""
    clean = {(each.job.subject, each.job.setting): each for each in outcomes if not each.job.fault}
    faults = [each for each in outcomes if each.job.fault]
    right = [is_right(each, clean[each.job.subject, each.job.setting]) for each in faults]
    trusted = [each for each, is_it in zip(faults, right, strict=True) if not is_it and each.level == TRUSTWORTHY]
    others = len(right) - sum(right) - len(trusted)
    flagged = [each for each in clean.values() if each.level != TRUSTWORTHY]
    totals = (
        f"Called trustworthy wrongly: {len(trusted)} of {len(faults)} faults; other wrong answers: {others}; flagged "
        f"without a fault: {len(flagged)} of {len(clean)}.\n\n"
    )
    lines = [[*_HEADER], ["---"] * len(_HEADER)]
    lines += [_cells(each, clean, "–" if each.level == TRUSTWORTHY else "flagged") for each in clean.values()]
    lines += [_cells(each, clean, "yes" if is_it else "no") for each, is_it in zip(faults, right, strict=True)]
    return totals + markdown(lines)


def _cells(each: Outcome, clean: Mapping[tuple[str, str], Outcome], right: str) -> list[str]:
    """Return the cells of an outcome."""
    before = clean[each.job.subject, each.job.setting].errors if each.job.fault else None
    cells = [NONE] * 3
    if each.errors is not None:
        pairs = [
            (value, np.nan if before is None else former)
            for value, former in zip(_shown(each.errors), _shown(before or each.errors), strict=True)
        ]
        digits = (0, 0, 2)
        cells = [
            NONE if np.isnan(value) else f"{value:.{n}f}" if np.isnan(former) else f"{former:.{n}f} → {value:.{n}f}"
            for (value, former), n in zip(pairs, digits, strict=True)
        ]
    sentence = re.sub(r"\s+", " ", each.sentence).replace("|", "/")
    return [each.job.fault or "none", each.job.subject, each.job.setting, each.level, sentence, *cells, right]


def _shown(errors: Errors) -> tuple[float, float, float]:
    return 1e3 * errors.pose_m, 1e3 * errors.place_m, errors.speed
