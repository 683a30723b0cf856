"""Resume recorded runs: at a frame (`from=RUN.rrd@120`), with changes (`from=RUN.rrd seed=3`), or where an earlier
attempt was interrupted."""

import hashlib
import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from workbench.core.filter_state import ResumePoint
from workbench.core.state_space import StateSpace
from workbench.core.step import Inference, Resumable, Step, resumable
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import composed
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.experiment.provenance import Command, identity
from workbench.experiment.tracking import Components, Meter, assemble
from workbench.recording.read.partial_run import Earlier, checkpoint_frames, earlier, past_before, recorded_poses
from workbench.recording.read.reader import Run, read
from workbench.recording.settings import NO_EFFECT, choices_of, leaves
from workbench.recording.write.recorder import Recorder
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Continuation:
    """A frame of a recorded run at which another run resumes.

    The frames since the last checkpoint before it (without one, all frames) are repeated with the recorded
    configuration. The frame itself is the initial condition of the frames after it. Without changes these are bitwise
    identical to the run's. With changes they start from its particles, its likelihood's memory and, for an equal seed,
    from its random streams.

    recorded_config: the recorded configuration as it runs here. changed: whether the resumed run has another one.
    earlier: the frames before, which the resumed run includes; None: the resumed run begins with the frame.
    """

    run: Run
    frame: int
    recorded_config: DictConfig
    changed: bool
    earlier: Earlier | None = None

    def __post_init__(self) -> None:
        frames = self.run.poses[0]
        if self.frame not in frames:
            span = f"{frames[0]} to {frames[-1]}" if len(frames) else "none"
            raise InputError(f"{self.run.path}: expected a recorded frame after @ ({span}), found {self.frame}")
        if "parent_frame" in self.run.provenance and not any(at < self.frame for at in checkpoint_frames(self.run)):
            raise InputError(
                f"{self.run.path}: resumes at frame {self.run.provenance['parent_frame']} of another run and has no "
                "checkpoint before the requested frame; resume that run, or repeat this one with "
                "recorder.checkpoints=true"
            )

    @cached_property
    def recorded(self) -> tuple[IntArray, FloatArray]:
        """Frame numbers (T,) and poses (T, P) of the run and of the run that it resumes."""
        return recorded_poses(self.run)

    @property
    def skipped(self) -> int:
        """Number of the run's frames before this one."""
        return int((self.recorded[0] < self.frame).sum())

    def identity(self, configuration: str) -> str:
        """Return the identity: that of the configuration for a whole run, else another one."""
        if self.earlier is not None:
            return configuration
        return hashlib.sha256(f"{configuration} from {self.run.id}@{self.frame}".encode()).hexdigest()

    @property
    def provenance(self) -> dict[str, str]:
        """Attempts that a whole run resumes, with their frames; empty for a branch."""
        if self.earlier is None:
            return {}
        attempts = [self.run.provenance.get("continued"), f"{self.run.id}@{self.frame}"]
        return {"continued": ", ".join(str(attempt) for attempt in attempts if attempt)}

    def track(
        self, components: Components, seed: int, meter: Meter, recorder: Recorder
    ) -> Iterator[tuple[Step, dict[str, float]]]:
        """Yield the steps from the frame on with their errors; the recorder adds the earlier frames.

        Raises
        ------
        InputError : an inference that cannot resume or needs other particles, frames that are not the run's, or a
            damaged checkpoint.
        """
        if (earlier := self.earlier) is not None:
            recorder.take_over(earlier.chunks(), earlier.frames, earlier.poses, earlier.ranks, earlier.picture)
            meter.count(earlier.ranks)
        expected: list[FloatArray] = []
        steps = self._steps(components, seed, expected)
        first = next(steps)
        before: list[tuple[int, float, FloatArray]] = []
        for number, pose, frame in zip(
            *(each[: self.skipped] for each in self.recorded), components.clip, strict=False
        ):
            if frame.index != number:
                raise InputError(
                    f"config: expected the first frame of the resumed run, {self.recorded[0][0]}, found another"
                )
            meter.catch_up(replace(first, frame=frame, expected_pose=pose))
            before.append((frame.index, frame.time_s, pose))
        if earlier is None:
            recorder.update((*frame, pose) for frame, pose in zip(before, expected, strict=False))
        yield first, meter.errors(first)
        for step in steps:
            yield step, meter.errors(step)

    def _steps(self, components: Components, seed: int, expected: list[FloatArray]) -> Iterator[Step]:
        """Yield the steps from the frame on; fills `expected` with the poses that updated the likelihood before it."""
        after = as_resumable(components.inference)
        if not self.changed:
            yield from self._repeated_steps(components, expected)
            return
        old = assemble(self.recorded_config)
        _check_columns(old.inference.space, components.inference.space)
        step, past = self.step_and_past(old)
        expected += list(past.filtered_poses)
        past = transferred(past, seed == int(self.recorded_config.seed))
        yield replace(step, filter_state=past.filter_state)
        yield from after.run(components.clip, past, rng_streams(seed))

    def step_and_past(self, components: Components) -> tuple[Step, ResumePoint]:
        """Return the frame's step with the recorded configuration, and the state from which to resume."""
        expected: list[FloatArray] = []
        step = next(self._repeated_steps(components, expected))
        assert step.filter_state is not None  # as the inference is resumable
        return step, ResumePoint(np.array(expected), step.filter_state)

    def _repeated_steps(self, components: Components, expected: list[FloatArray]) -> Iterator[Step]:
        """Yield the recorded configuration's steps from the frame on; fills `expected` with the poses of all steps.

        Logs a warning for the first repeated frame that is not identical to the recorded one.
        """
        past = past_before(self.run, self.frame)
        expected += [] if past is None else list(past.filtered_poses)
        start, n = components.start if past is None else past, self.skipped - len(expected)
        recorded, same = dict(zip(self.recorded[0].tolist(), self.recorded[1], strict=True)), True
        log.info("%d frames are repeated before frame %d", n, self.frame)
        with tqdm(total=n, desc="repeat", unit="frame", disable=None, leave=False) as bar:
            for step in as_resumable(components.inference).run(
                components.clip, start, rng_streams(int(self.recorded_config.seed))
            ):
                number = step.frame.index
                if same and number <= self.frame and number in recorded:
                    same = np.array_equal(step.expected_pose, recorded[number])
                    if not same:
                        reason = "code, libraries or data have changed; the run resumes from the repeated frame"
                        log.warning("frame %d is not identical to the recorded one: %s", number, reason)
                bar.update(number < self.frame)
                expected.append(step.expected_pose if step.filter_state is None else step.filter_state.filtered_pose)
                if number >= self.frame:
                    yield step


def transferred(past: ResumePoint, same_streams: bool) -> ResumePoint:
    """Return the state for other components: without the prior's decoded poses and, for other streams, without the
    states of the generators."""
    arrays = {name: array for name, array in past.filter_state.arrays.items() if name != "poses"}
    streams = past.filter_state.rng_states if same_streams else {}
    return replace(past, filter_state=replace(past.filter_state, arrays=arrays, rng_states=streams))


def as_resumable(inference: Inference) -> Resumable:
    """Return the inference; InputError if it cannot resume at a frame."""
    if resumable(inference):
        return inference
    raise InputError(
        f"inference: {type(inference).__name__} cannot resume at a frame, as it uses all frames at once or has a state "
        "beyond particles; choose a particle filter, also within reinitializing or fixed_lag"
    )


def _check_columns(recorded: StateSpace, current: StateSpace) -> None:
    """Raise InputError if two state spaces have different columns."""
    if (recorded.names, recorded.units) != (current.names, current.units):
        names = (*recorded.names, *current.names)
        different = next((name for name in names if (name in recorded.names) != (name in current.names)), "order")
        raise InputError(
            f"prior: the run's particles have {len(recorded)} columns, this prior's {len(current)}, which differ in "
            f"{different}; expected a prior with the same columns"
        )


def find_resumable(config: DictConfig, recordings: Iterable[Path]) -> Continuation | str | None:
    """Return a continuation of the longest earlier attempt at this configuration, or a text with the reason for none.

    None if no attempt has recorded a frame. Except for the images of marginals, the resumed run is bitwise identical
    to an uninterrupted one. Configuration, code and inputs must therefore be the same.
    """
    attempts: list[Earlier] = []
    reason: str | None = None
    for recording in recordings:
        try:
            run = read(recording)
            if run.is_study or not len(run.poses[0]):
                continue
            if run.provenance.get("identity") != identity(config):
                reason = "the code, the configuration or an input file has changed"
            elif (attempt := earlier(run)) is None:
                reason = "it has no checkpoint; recorder.checkpoints=true stores them"
            elif past_before(run, attempt.until) is not None:
                attempts.append(attempt)
        except InputError as error:
            reason = str(error)
    if not attempts:
        return reason
    best = max(attempts, key=lambda attempt: attempt.until)
    return Continuation(best.run, best.until, config, changed=False, earlier=best)


def path_overrides(overrides: Iterable[str]) -> list[str]:
    """Return the overrides of paths."""
    return [text for text in overrides if text.startswith("paths.")]


def continuation_at(run: Run, frame: int, overrides: Sequence[str]) -> Continuation:
    """Return the continuation of a run at a frame with these overrides; InputError for a frame that is not recorded."""
    recorded, current = (branch_config(run, words)[0] for words in (path_overrides(overrides), overrides))
    first, second = (OmegaConf.to_container(config, resolve=True) for config in (recorded, current))
    return Continuation(run, frame, recorded, changed=bool(changes(first, second)))


def branch_config(run: Run, overrides: Sequence[str], frame: int | None = None) -> tuple[DictConfig, Command]:
    """Return the recorded configuration with overrides, and its command; see `branch`."""
    chosen = {group: name for group, _, name in (text.partition("=") for text in overrides) if group in GROUPS}
    keys = [text for text in overrides if text.partition("=")[0] not in chosen]
    choices, components = {**_choices(run), **chosen}, dict[str, Any]()
    if chosen:
        today = composed([*(f"{group}={name}" for group, name in choices.items()), *path_overrides(keys)])
        plain: Any = OmegaConf.to_container(today, resolve=True)
        components = {group: plain[group] for group in chosen}
    config = runnable_config(run, keys, current_defaults(keys), components)
    at = "" if frame is None else f"@{frame}"
    return config, Command([f"from={run.path}{at}", *overrides], choices, run.id, frame)


def changes(before: Any, after: Any) -> list[str]:
    """Return "key: before → after" for every key that differs, except keys without effect on the numbers."""
    first, second = dict(leaves(before)), dict(leaves(after))
    names = [name for name in dict.fromkeys([*first, *second]) if name.partition(".")[0] not in NO_EFFECT]
    values = ((name, first.get(name, "missing"), second.get(name, "missing")) for name in names)
    return [f"{name}: {old} → {new}" for name, old, new in values if old != new]


def _choices(run: Run) -> dict[str, str]:
    """Return the recorded experiment and options, as far as they exist today."""
    provenance = run.provenance
    recorded, experiment = choices_of(provenance.get("choices") or ()), str(provenance.get("experiment", "custom"))
    existing = {group: name for group, name in recorded.items() if group in GROUPS and name in options(group)}
    return {"experiment": experiment if experiment in options("experiment") else "custom", **existing}
