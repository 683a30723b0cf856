"""Common parts of the likelihoods' looks: poses that are not finite, and what is kept for the next frame."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, FrameLikelihood, Likelihood
from workbench.utils.arrays import BoolArray, FloatArray

Memory = TypeVar("Memory")


@dataclass(frozen=True, eq=False)
class PoseLook:
    """A look by which poses are judged as they are, wherever they came from. name: of the likelihood, for its notes.
    judge: gives the log likelihoods (N,) of finite poses (N, P). then: gives the likelihood of the next frame from the
    pose (P,) expected in this one."""

    name: str
    judge: Callable[[FloatArray], FloatArray]
    then: Callable[[FloatArray], Likelihood]
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P), −∞ and a note for those not finite; the previous ones do not matter."""
        finite = finite_rows(pose)
        return among_finite(self.name, finite, self.judge(those(pose, finite)))

    def update(self, expected_pose: FloatArray) -> Likelihood:
        """The likelihood of the next frame."""
        return self.then(expected_pose)


@dataclass(frozen=True, eq=False)
class Remembering(Generic[Memory]):
    """A likelihood, which stays as it was configured, and what it keeps of the frames so far. see: looks at a frame and
    the one before with that in mind."""

    memory: Memory
    see: Callable[[Memory, Frame | None, Frame], FrameLikelihood]

    def prepare(self, previous: Frame | None, frame: Frame) -> FrameLikelihood:
        """Look at a frame and the one before."""
        return self.see(self.memory, previous, frame)


def finite_rows(poses: FloatArray) -> BoolArray:
    """Return which (N,) of poses (N, P) are finite."""
    finite = np.isfinite(poses)
    return np.ones(len(poses), dtype=np.bool_) if finite.all() else np.asarray(finite.all(axis=1))


def those(poses: FloatArray, finite: BoolArray) -> FloatArray:
    """Select the poses (M, P) of (N, P) that are `finite` (N,); where all are, no copy."""
    return poses if finite.all() else poses[finite]


def among_finite(name: str, finite: BoolArray, log_prob: FloatArray, notes: tuple[str, ...] = ()) -> Evaluation:
    """The evaluation of N poses of which some are `finite` (N,), with log likelihoods (M,), and others impossible."""
    if finite.all():
        return Evaluation(log_prob, notes)
    everyone = np.full(len(finite), -np.inf)
    everyone[finite] = log_prob
    return Evaluation(everyone, (*notes, f"{name}: {(~finite).sum()} of {len(finite)} poses were not finite"))
