"""A run that goes on from a frame of a recorded one, as that did or otherwise."""

import hashlib
import logging
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from omegaconf import DictConfig
from tqdm import tqdm

from workbench.core.filter_state import Past
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace
from workbench.core.step import Continuing, Inference, Step, continues
from workbench.experiment.assembly import assemble
from workbench.experiment.tracking import Meter, Parts
from workbench.recording.read.partial_run import Earlier, checkpoint_frames, past_before, recorded_poses
from workbench.recording.read.reader import Run
from workbench.recording.write.recorder import Recorder
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Continued:
    """A frame of a recorded run to go on from. was: the recorded configuration as it runs here. changed: whether the
    run that goes on has another. earlier: the frames before it, which what goes on takes over and so becomes the whole
    run; None: it begins with the frame.

    The frames since the last checkpoint before it, or all where there is none, are repeated as they were, which takes
    as long as it took. Then come the frame itself, which counts as given, and those after it. Unchanged, they are the
    run's, bit by bit; otherwise they start from its particles, its likelihood's memory, and where the seed is the same,
    from its random streams.
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
    def told(self) -> tuple[IntArray, FloatArray]:
        """The numbers of the frames that the run, or the one that it goes on from, told of, and their poses."""
        return recorded_poses(self.run)

    @property
    def skipped(self) -> int:
        """Count the run's frames before this one."""
        return int((self.told[0] < self.frame).sum())

    def identity(self, configuration: str) -> str:
        """Tell apart what comes out from a whole run of the configuration of this identity, unless it is one."""
        if self.earlier is not None:
            return configuration
        come_from = f"{configuration} from {self.run.id}@{self.frame}"
        return hashlib.sha256(come_from.encode()).hexdigest()

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
        for frame, pose in self._told_before(parts):
            meter.catch_up(replace(first, frame=frame, expected_pose=pose))
            before.append((frame.index, frame.time_s, pose))
        if own is None:
            recorder.remember((*each, pose) for each, pose in zip(before, expected, strict=False))
        yield first, meter.errors(first)
        for step in steps:
            yield step, meter.errors(step)

    def _told_before(self, parts: Parts) -> Iterator[tuple[Frame, FloatArray]]:
        """Return the frames before this one, with the poses that the run told of them."""
        for number, pose, frame in zip(*(each[: self.skipped] for each in self.told), parts.clip, strict=False):
            if frame.index != number:
                raise InputError(f"config: the run began with frame {self.told[0][0]}, this one would with another")
            yield frame, pose

    def _steps(self, parts: Parts, seed: int, expected: list[FloatArray]) -> Iterator[Step]:
        """Yield the steps from the frame on; `expected` is filled with what the likelihood was told up to it."""
        after = continuing(parts.inference)
        if not self.changed:
            yield from self._on(parts, expected)
            return
        old = assemble(self.was, lambda stage: nullcontext())
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
        """Yield the recorded configuration's steps from the frame on; `expected` is filled with the poses of all."""
        past = past_before(self.run, self.frame)
        expected += [] if past is None else list(past.expected)
        start = parts.start if past is None else past
        repeated = continuing(parts.inference).run(parts.clip, start, rng_streams(int(self.was.seed)))
        for step in self._repeated(repeated, self.skipped - len(expected)):
            expected.append(step.expected_pose if step.memory is None else step.memory.expected)
            if step.frame.index >= self.frame:
                yield step

    def _repeated(self, steps: Iterator[Step], n: int) -> Iterator[Step]:
        """Pass the steps on, and say so where one does not come out as it was recorded; n: that are repeated."""
        recorded = dict(zip(self.told[0].tolist(), self.told[1], strict=True))
        log.info("%d frames are repeated before frame %d", n, self.frame)
        same = True
        with tqdm(total=n, desc="repeat", unit="frame", disable=None, leave=False) as bar:
            for step in steps:
                if same and step.frame.index <= self.frame:
                    same = self._as_recorded(step, recorded.get(step.frame.index))
                bar.update(step.frame.index < self.frame)
                yield step

    def _as_recorded(self, step: Step, recorded: FloatArray | None) -> bool:
        if recorded is None or np.array_equal(step.expected_pose, recorded):
            return True
        words = "code, libraries or data are not the run's; it goes on from what comes out now"
        log.warning("frame %d does not come out as it was recorded: %s", step.frame.index, words)
        return False


def carried(past: Past, same_streams: bool) -> Past:
    """Return a past for others than the parts that it is of: their prior decodes, and other streams may be drawn
    from."""
    arrays = {name: array for name, array in past.memory.arrays.items() if name != "poses"}
    streams = past.memory.streams if same_streams else {}
    return replace(past, memory=replace(past.memory, arrays=arrays, streams=streams))


def continuing(inference: Inference) -> Continuing:
    """Return the inference itself; raises InputError where it cannot go on from a frame."""
    if continues(inference):
        return inference
    raise InputError(
        f"inference: {type(inference).__name__} cannot go on from a frame, as it tells each by all frames or keeps "
        "more than particles; particle filters can, also inside of restarting and fixed_lag"
    )


def _check_columns(were: StateSpace, are: StateSpace) -> None:
    """Raise InputError where particles of one state space are none of the other."""
    if (were.names, were.units) != (are.names, are.units):
        other = next(
            (name for name in (*were.names, *are.names) if (name in were.names) != (name in are.names)), "order"
        )
        raise InputError(
            f"prior: the run's particles have {len(were)} columns, this prior's {len(are)}, which differ in {other}; "
            "a run goes on with a prior of the same columns only"
        )
