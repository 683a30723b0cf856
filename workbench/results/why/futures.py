"""Runs that go on from before a loss with one thing changed, several seeds of each."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numba
import numpy as np
from threadpoolctl import threadpool_limits

from workbench.body.angles import exchanged
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.core.filter_state import Memory, Past
from workbench.core.prior import Prior
from workbench.core.step import Step
from workbench.evaluation.errors import step_errors
from workbench.evaluation.pose_errors import step_errors
from workbench.evaluation.track_loss import WINDOW, lost_and_found
from workbench.evaluation.verdict import WINDOW, lost_and_found
from workbench.experiment.assembly import assemble
from workbench.experiment.branch import branched
from workbench.experiment.config.options import name_parts, packages
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.resume import Continued, branched, carried, continuing
from workbench.experiment.tracking import Parts, assemble
from workbench.inference.smc.particle_filter import start_around
from workbench.inference.smc.weights import even_log_weights
from workbench.recording.read.reader import Run, read
from workbench.results.why.changes import Change
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.processes import pool
from workbench.utils.rng import rng_streams

BEFORE, AFTER = 15, 10
"""Frames before a loss from which futures go on, and after it up to which the person must be held."""


@dataclass(frozen=True)
class Loss:
    """frame: where the person was lost. begin: the frame that futures go on from. end: their last."""

    frame: int
    begin: int
    end: int


@dataclass(frozen=True, eq=False)
class Future:
    """One seed's run with a change, up to a loss or the end. frames: (F,). errors: (F,), of the image, in widths of a
    forearm, NaN where no truth is known. times_s: (F,). places: (F, J, 3), m, the expected pose's joints. cameras:
    through which they are seen. held: whether nobody was lost."""

    change: Change
    seed: int
    frames: IntArray
    errors: FloatArray
    times_s: FloatArray
    places: FloatArray
    cameras: tuple[Camera, ...]
    held: bool


Task: TypeAlias = tuple[Path, Past | None, Loss, Change, Sequence[int], Sequence[str]]
"""The arguments of `futures`."""


def losses(run: Run) -> list[Loss]:
    """Find the frames in which the run lost the person; raises InputError where its recording cannot tell."""
    frames, errors = run.metric("error_px")
    _, widths = run.metric("forearm_px")
    first, last = int(frames[0]), int(frames[-1])
    found = [
        int(frames[event.frame]) for event in lost_and_found(errors.tolist(), widths.tolist()) if event.kind == "lost"
    ]
    return [Loss(frame, max(first, frame - BEFORE), min(last, frame + AFTER)) for frame in found]


def past_of(run: Run, loss: Loss, overrides: Sequence[str]) -> Past | None:
    """Return what futures of a loss go on from; None where it is the first frame, or the inference cannot go on."""
    config = branched(run, overrides)[0]
    parts = assemble(config)
    try:
        continuing(parts.inference)
    except InputError:
        return None
    if loss.begin == int(run.poses[0][0]):
        return None
    return Continued(run, loss.begin, config, changed=True).reached(parts)[1]


def futures(
    path: Path, past: Past | None, loss: Loss, change: Change, seeds: Sequence[int], overrides: Sequence[str]
) -> list[Future]:
    """Run a change with some seeds. overrides: of all futures. Raises InputError for what cannot be changed so."""
    numba.set_num_threads(1)
    with threadpool_limits(limits=1, user_api="blas"):
        config = branched(read(path), [*overrides, *change.overrides])[0]
        parts = assemble(config)
        return [_future(parts, None if change.whole else past, loss, change, seed) for seed in seeds]


def all_futures(tasks: Sequence[Task], jobs: int) -> Iterator[list[Future] | InputError]:
    """Run tasks in so many processes, in their order; what is refused comes back as its error."""
    if jobs == 1:
        yield from map(_attempt, tasks)
        return
    with pool(jobs, _prepare, packages()[1:]) as executor:
        yield from executor.map(_attempt, tasks)


def _prepare(named: Iterable[str]) -> None:
    """Let a new process compose and build what this one can."""
    name_parts(named)
    prepare_hydra()


def _attempt(task: Task) -> list[Future] | InputError:
    try:
        return futures(*task)
    except InputError as error:
        return error


def _future(parts: Parts, past: Past | None, loss: Loss, change: Change, seed: int) -> Future:
    steps, errors, held = list[Step](), list[float](), True
    for step in _steps(parts, past, change, seed):
        if not held or step.frame.index > loss.end:
            break
        found = step_errors(step, parts.body, parts.parameters, parts.clip.known.scale)
        steps.append(step)
        errors.append(found.get("error_px", np.nan) / found.get("forearm_px", np.nan))
        held = len(errors) < WINDOW or not lost_and_found(errors, [1.0] * len(errors))
    frames, times_s = np.array([step.frame.index for step in steps]), np.array([step.frame.time_s for step in steps])
    places = joints(parts.body.skeleton, np.stack([step.expected_pose for step in steps]))
    return Future(change, seed, frames, np.array(errors), times_s, places, parts.clip.known.cameras, held)


def _steps(parts: Parts, past: Past | None, change: Change, seed: int) -> Iterator[Step]:
    streams = rng_streams(seed)
    if past is None:
        start = parts.start if not change.mirrored or parts.start is None else exchanged(np.atleast_2d(parts.start)[0])
        return parts.inference.run(parts.clip, start, streams)
    after, prior = continuing(parts.inference), parts.prior
    if change.mirrored and prior is not None:
        past = anew(past, prior, exchanged(past.memory.expected), streams["start"])
    return after.run(parts.clip, carried(past, same_streams=False), streams)


def anew(past: Past, prior: Prior, pose: FloatArray, rng: np.random.Generator) -> Past:
    """Return a past whose particles start around a pose (P,), while the likelihood remembers what it did."""
    n = len(past.memory.array("log_weights", None))
    arrays: dict[str, AnyArray] = {
        "state": start_around(prior, pose[None], n, rng), "log_weights": even_log_weights(n),
        "origins": np.empty((0, n), dtype=np.int32), "log_evidence": np.zeros(1),
    }  # fmt: skip
    return Past(past.expected, Memory(arrays, past.memory.expected, {}))
