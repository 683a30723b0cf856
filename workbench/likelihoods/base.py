"""Common frame likelihoods, and the treatment of non-finite poses."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, FrameLikelihood, Likelihood
from workbench.utils.arrays import BoolArray, FloatArray

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class PoseFrameLikelihood:
    """A frame likelihood of the present pose alone. name: of the likelihood, for its notes. log_prob: maps finite poses
    (N, P) to log likelihoods (N,). next_likelihood: maps the frame's expected pose (P,) to the likelihood of the next
    frame."""

    name: str
    log_prob: Callable[[FloatArray], FloatArray]
    next_likelihood: Callable[[FloatArray], Likelihood]
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log likelihoods (N,) of poses (N, P), −∞ and a note where not finite; previous poses are ignored."""
        finite = finite_rows(pose)
        return expand_finite(self.name, finite, self.log_prob(select_finite(pose, finite)))

    def update(self, expected_pose: FloatArray) -> Likelihood:
        """Return the likelihood of the next frame."""
        return self.next_likelihood(expected_pose)


@dataclass(frozen=True, eq=False)
class AdaptiveLikelihood(Generic[State]):
    """A likelihood with a state learned from the previous frames; its configuration is constant. prepare_with: maps the
    state, the previous frame and a frame to the frame's likelihood."""

    state: State
    prepare_with: Callable[[State, Frame | None, Frame], FrameLikelihood]

    def prepare(self, previous: Frame | None, frame: Frame) -> FrameLikelihood:
        """Return the likelihood of a frame, given the previous one."""
        return self.prepare_with(self.state, previous, frame)


def finite_rows(poses: FloatArray) -> BoolArray:
    """Return which (N,) of poses (N, P) are finite."""
    finite = np.isfinite(poses)
    return np.ones(len(poses), dtype=np.bool_) if finite.all() else np.asarray(finite.all(axis=1))


def select_finite(poses: FloatArray, finite: BoolArray) -> FloatArray:
    """Return the poses (M, P) of (N, P) that are `finite` (N,); no copy if all are."""
    return poses if finite.all() else poses[finite]


def expand_finite(name: str, finite: BoolArray, log_prob: FloatArray, notes: tuple[str, ...] = ()) -> Evaluation:
    """Return the evaluation of N poses from the log likelihoods (M,) of the `finite` (N,) ones; −∞ for the others. name
    : of the likelihood, for the note about non-finite poses, which follows `notes`."""
    if finite.all():
        return Evaluation(log_prob, notes)
    expanded = np.full(len(finite), -np.inf)
    expanded[finite] = log_prob
    return Evaluation(expanded, (*notes, f"{name}: {(~finite).sum()} of {len(finite)} poses were not finite"))
