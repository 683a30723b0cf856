"""Runs that go on from a recorded one: from a frame (`from=RUN.rrd@120`), with changes (`from=RUN.rrd seed=3`), or
from where an earlier attempt was cut off."""

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

from workbench.core.filter_state import Past
from workbench.core.state_space import StateSpace
from workbench.core.step import Inference, Resumable, Step, resumable
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import composed
from workbench.experiment.config.stored import own_defaults, runnable
from workbench.experiment.provenance import Command, identity
from workbench.experiment.tracking import Meter, Parts, assemble
from workbench.recording.migrations import provenance_in_todays_words
from workbench.recording.read.partial_run import Earlier, checkpoint_frames, earlier, past_before, recorded_poses
from workbench.recording.read.reader import Run, read
from workbench.recording.settings import NO_EFFECT, choices_of, leaves
from workbench.recording.write.recorder import Recorder
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Continued:
    """A frame of a recorded run to go on from.

    The frames since the last checkpoint before it, or all where there is none, are repeated as they were. Then come the
    frame itself, which counts as given, and those after it. Unchanged, they are the run's, bit by bit; otherwise they
    start from its particles, its likelihood's memory, and where the seed is the same, from its random streams.

    was: the recorded configuration as it runs here. changed: whether the run that goes on has another. earlier: the
    frames before it, which what goes on takes over and so becomes the whole run; None: it begins with the frame.
    """

    run: Run
    frame: int
    was: DictConfig
    changed: bool
    earlier: Earlier | None = None

    def __post_init__(self) -> None:
        frames = self.run.poses[0]
        if self.frame not in frames:
            found = f"{frames[0]} to {frames[-1]}" if len(frames) else "none"
            raise InputError(f"{self.run.path}: expected a frame that is recorded after @, {found}, not {self.frame}")
        if "parent_frame" in self.run.provenance and not any(at < self.frame for at in checkpoint_frames(self.run)):
            raise InputError(
                f"{self.run.path}: itself goes on from frame {self.run.provenance['parent_frame']} of another run and "
                "has no checkpoint before this one; go on from that run, or make this one with "
                "recorder.checkpoints=true"
            )

    @cached_property
    def recorded(self) -> tuple[IntArray, FloatArray]:
        """The numbers of the frames of the run, and of the one that it goes on from, and their poses."""
        return recorded_poses(self.run)

    @property
    def skipped(self) -> int:
        """Count the run's frames before this one."""
        return int((self.recorded[0] < self.frame).sum())

    def identity(self, configuration: str) -> str:
        """Return an identity other than that of a whole run of this configuration, unless it is one."""
        if self.earlier is not None:
            return configuration
        return hashlib.sha256(f"{configuration} from {self.run.id}@{self.frame}".encode()).hexdigest()

    @property
    def provenance(self) -> dict[str, str]:
        """Say which attempts what comes out goes on from, and where, where it is a whole run; of a branch: nothing."""
        if self.earlier is None:
            return {}
        attempts = [self.run.provenance.get("continued"), f"{self.run.id}@{self.frame}"]
        return {"continued": ", ".join(str(each) for each in attempts if each)}

    def track(
        self, parts: Parts, seed: int, meter: Meter, recorder: Recorder
    ) -> Iterator[tuple[Step, dict[str, float]]]:
        """Yield the steps from the frame on with their errors, as `tracking.track` does; the recorder takes over what
        lies before.

        Raises InputError where the inference cannot go on, or not from the run's particles, where the frames are not
        the run's, and for a damaged checkpoint.
        """
        if (own := self.earlier) is not None:
            recorder.take_over(own.chunks(), own.frames, own.poses, own.ranks, own.picture)
            meter.count(own.ranks)
        expected: list[FloatArray] = []
        steps = self._steps(parts, seed, expected)
        first = next(steps)
        before: list[tuple[int, float, FloatArray]] = []
        for number, pose, frame in zip(*(each[: self.skipped] for each in self.recorded), parts.clip, strict=False):
            if frame.index != number:
                raise InputError(f"config: the run began with frame {self.recorded[0][0]}, this one would with another")
            meter.catch_up(replace(first, frame=frame, expected_pose=pose))
            before.append((frame.index, frame.time_s, pose))
        if own is None:
            recorder.update((*each, pose) for each, pose in zip(before, expected, strict=False))
        yield first, meter.errors(first)
        for step in steps:
            yield step, meter.errors(step)

    def _steps(self, parts: Parts, seed: int, expected: list[FloatArray]) -> Iterator[Step]:
        """Yield the steps from the frame on; `expected` is filled with the poses given to the likelihood up to it."""
        after = continuing(parts.inference)
        if not self.changed:
            yield from self._on(parts, expected)
            return
        old = assemble(self.was)
        _check_columns(old.inference.space, parts.inference.space)
        step, past = self.reached(old)
        expected += list(past.expected)
        past = carried(past, seed == int(self.was.seed))
        yield replace(step, memory=past.memory)
        yield from after.run(parts.clip, past, rng_streams(seed))

    def reached(self, parts: Parts) -> tuple[Step, Past]:
        """Return the frame's step as the parts of the recorded configuration take it, and what goes on from it."""
        expected: list[FloatArray] = []
        step = next(self._on(parts, expected))
        assert step.memory is not None  # as the inference continues
        return step, Past(np.array(expected), step.memory)

    def _on(self, parts: Parts, expected: list[FloatArray]) -> Iterator[Step]:
        """Yield the recorded configuration's steps from the frame on; `expected` is filled with the poses of all.

        Warns of the first repeated frame that is not as it was recorded.
        """
        past = past_before(self.run, self.frame)
        expected += [] if past is None else list(past.expected)
        start, n = parts.start if past is None else past, self.skipped - len(expected)
        recorded, same = dict(zip(self.recorded[0].tolist(), self.recorded[1], strict=True)), True
        log.info("%d frames are repeated before frame %d", n, self.frame)
        with tqdm(total=n, desc="repeat", unit="frame", disable=None, leave=False) as bar:
            for step in continuing(parts.inference).run(parts.clip, start, rng_streams(int(self.was.seed))):
                number = step.frame.index
                if same and number <= self.frame and number in recorded:
                    same = np.array_equal(step.expected_pose, recorded[number])
                    if not same:
                        words = "code, libraries or data are not the run's; it goes on from what comes out now"
                        log.warning("frame %d does not come out as it was recorded: %s", number, words)
                bar.update(number < self.frame)
                expected.append(step.expected_pose if step.memory is None else step.memory.expected)
                if number >= self.frame:
                    yield step


def carried(past: Past, same_streams: bool) -> Past:
    """Return a past for other parts than its own: without the poses that their prior decoded, and, where the streams
    are not the same, without the states of the generators."""
    arrays = {name: array for name, array in past.memory.arrays.items() if name != "poses"}
    streams = past.memory.streams if same_streams else {}
    return replace(past, memory=replace(past.memory, arrays=arrays, streams=streams))


def continuing(inference: Inference) -> Resumable:
    """Return the inference itself; raises InputError where it cannot go on from a frame."""
    if resumable(inference):
        return inference
    raise InputError(
        f"inference: {type(inference).__name__} cannot go on from a frame, as it tells each by all frames or keeps "
        "more than particles; particle filters can, also inside of restarting and fixed_lag"
    )


def _check_columns(were: StateSpace, are: StateSpace) -> None:
    """Raise InputError where particles of one state space are none of the other."""
    if (were.names, were.units) != (are.names, are.units):
        both = (*were.names, *are.names)
        other = next((name for name in both if (name in were.names) != (name in are.names)), "order")
        raise InputError(
            f"prior: the run's particles have {len(were)} columns, this prior's {len(are)}, which differ in {other}; "
            "a run goes on with a prior of the same columns only"
        )


def resumed(config: DictConfig, recordings: Iterable[Path]) -> Continued | str | None:
    """Go on with the attempt at this configuration that got farthest; a text says why none can be gone on with.

    None where none has recorded a frame. What comes out is, but for pictures of marginals, what the run would have come
    to if nothing had cut it off: so the code must be the same, too.
    """
    found: list[Earlier] = []
    reason: str | None = None
    for recording in recordings:
        try:
            run = read(recording)
            if run.is_study or not len(run.poses[0]):
                continue
            if run.provenance.get("identity") != identity(config):
                reason = "the code, the configuration or a file that it names was another"
            elif (part := earlier(run)) is None:
                reason = "it had no checkpoint, which recorder.checkpoints=true stores"
            elif past_before(run, part.until) is not None:
                found.append(part)
        except InputError as error:
            reason = str(error)
    if not found:
        return reason
    best = max(found, key=lambda part: part.until)
    return Continued(best.run, best.until, config, changed=False, earlier=best)


def paths_of(overrides: Iterable[str]) -> list[str]:
    """Select the overrides of paths."""
    return [text for text in overrides if text.startswith("paths.")]


def continued_at(run: Run, frame: int, overrides: Sequence[str]) -> Continued:
    """Continue from a frame of a run with these overrides; raises InputError for a frame that it does not have."""
    was, now = (branched(run, each)[0] for each in (paths_of(overrides), overrides))
    first, second = (OmegaConf.to_container(each, resolve=True) for each in (was, now))
    return Continued(run, frame, was, changed=bool(changes(first, second)))


def branched(run: Run, overrides: Sequence[str], frame: int | None = None) -> tuple[DictConfig, Command]:
    """Return the recorded configuration with overrides, and what stands for it as a command; see `branch`."""
    chosen = {group: name for group, _, name in (text.partition("=") for text in overrides) if group in GROUPS}
    keys = [text for text in overrides if text.partition("=")[0] not in chosen]
    choices, parts = {**_choices(run), **chosen}, dict[str, Any]()
    if chosen:
        today = composed([*(f"{group}={name}" for group, name in choices.items()), *paths_of(keys)])
        plain: Any = OmegaConf.to_container(today, resolve=True)
        parts = {group: plain[group] for group in chosen}
    config = runnable(run, keys, own_defaults(keys), parts)
    at = "" if frame is None else f"@{frame}"
    return config, Command([f"from={run.path}{at}", *overrides], choices, run.id, frame)


def changes(was: Any, now: Any) -> list[str]:
    """Describe every key that differs between two configurations, but for those that affect no number."""
    first, second = dict(leaves(was)), dict(leaves(now))
    names = [name for name in dict.fromkeys([*first, *second]) if name.partition(".")[0] not in NO_EFFECT]
    values = ((name, first.get(name, "not there"), second.get(name, "not there")) for name in names)
    return [f"{name}: {before} → {after}" for name, before, after in values if before != after]


def _choices(run: Run) -> dict[str, str]:
    """Return the recorded experiment and options, as far as there are such today."""
    provenance = provenance_in_todays_words(run.provenance)
    recorded, experiment = choices_of(provenance.get("choices") or ()), str(provenance.get("experiment", "custom"))
    found = {group: name for group, name in recorded.items() if group in GROUPS and name in options(group)}
    return {"experiment": experiment if experiment in options("experiment") else "custom", **found}
