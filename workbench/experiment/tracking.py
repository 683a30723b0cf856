"""The tracking loop: steps of an inference with their errors, whoever asks for them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from workbench.body.limbs import Body
from workbench.core.frame_cache import FrameCache
from workbench.core.prior import Prior
from workbench.core.step import Inference, Step
from workbench.evaluation.marker_offsets import MarkerOffsets
from workbench.evaluation.pose_errors import AccelerationError, step_errors
from workbench.evaluation.posterior_calibration import expected_calibration_error
from workbench.evaluation.step_calibration import group_errors, pose_ranks, stated_doubt
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import rng_streams


@dataclass(frozen=True, eq=False)
class Parts:
    """The live objects of one run. prior: None where the inference does without. start: (P,) the first pose, (n, P)
    several that are as likely, or None where the inference finds it."""

    clip: FrameCache
    body: Body
    prior: Prior | None
    inference: Inference
    start: FloatArray | None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose's parameters that move."""
        return self.body.skeleton.dof_names if self.prior is None else self.prior.parameters


class Meter:
    """Measures the errors of the steps of one run, in their order."""

    def __init__(self, parts: Parts) -> None:
        self._body, self._parameters, self._scale = parts.body, parts.parameters, parts.clip.known.scale
        self._acceleration = AccelerationError(parts.body.skeleton, parts.parameters)
        self._markers = MarkerOffsets(parts.body.skeleton, parts.parameters)
        self._first = True  # given, not tracked
        self._ranks: list[FloatArray] = []

    def errors(self, step: Step) -> dict[str, float]:
        """The step's errors by name, see `step_errors`, `AccelerationError`, `MarkerOffsets` and `group_errors`, and
        what it says of them itself, see `stated_doubt`."""
        errors = step_errors(step, self._body, self._parameters, self._scale)
        errors |= stated_doubt(step, self._body.skeleton) | group_errors(step, self._body.skeleton)
        if not self._first:
            self._ranks.append(pose_ranks(step))
        self._first = False
        return errors | self._acceleration.add(step) | self._markers.add(step)

    def catch_up(self, step: Step) -> None:
        """Take in a step before the first that is measured, for what looks back."""
        self._acceleration.add(step)
        self._markers.add(step)

    def count(self, ranks: Iterable[FloatArray]) -> None:
        """Count ranks (k,) of the run's frames before the first that is measured, which is then not its first."""
        self._ranks += ranks
        self._first = False

    @property
    def over_run(self) -> dict[str, float]:
        """Numbers of the run as a whole: lengths, mm, of the markers' offsets from their joints, as far as they are
        known, and the expected calibration error, see `calibration.expected_calibration_error`."""
        ranks = np.concatenate(self._ranks) if self._ranks else np.zeros(0)
        calibration = {"calibration_error": expected_calibration_error(ranks)} if len(ranks) else {}
        return self._markers.removed_mm | self._markers.lengths_mm | calibration


def track(parts: Parts, seed: int, meter: Meter | None = None) -> Iterator[tuple[Step, dict[str, float]]]:
    """Every frame's step with its errors, by the meter given or one of its own.

    Raises InputError for a negative seed and what the parts raise.
    """
    meter = Meter(parts) if meter is None else meter
    for step in parts.inference.run(parts.clip, parts.start, rng_streams(seed)):
        yield step, meter.errors(step)
