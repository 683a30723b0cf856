"""Build the components of a run from a configuration, and track with them."""

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from omegaconf import DictConfig

from workbench.body.limbs import Body
from workbench.core.capabilities import FIT
from workbench.core.dataset import SequenceInfo
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import Likelihood
from workbench.core.prior import Prior
from workbench.core.step import Inference, Step
from workbench.evaluation.errors.marker_offsets import MarkerOffsets
from workbench.evaluation.errors.pose_errors import AccelerationError, step_errors
from workbench.evaluation.uncertainty.posterior_calibration import expected_calibration_error
from workbench.evaluation.uncertainty.step_calibration import expected_errors, group_errors, pose_ranks
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.requirements import check_requirements, ignores_likelihood, traits_of
from workbench.inference.initialization.from_keypoints import trajectory_of_keypoints
from workbench.inference.initialization.poses import initial_poses
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Components:
    """The live objects of one run.

    prior: None for an inference without one. start: first pose (P,), several equally likely ones (n, P), or None for
    an inference that initializes itself.
    """

    clip: FrameCache
    body: Body
    prior: Prior | None
    inference: Inference
    start: FloatArray | None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose parameters that vary."""
        return self.body.skeleton.dof_names if self.prior is None else self.prior.parameters


def assemble(config: DictConfig) -> Components:
    """Check a configuration's requirements and return its components; InputError as `check_requirements`."""
    check_requirements(config, {})
    return build_components(config)


def build_components(
    config: DictConfig, stage: Callable[[str], AbstractContextManager[Any]] = nullcontext
) -> Components:
    """Return dataset, body, prior, likelihood and inference of a configuration, and the initial pose.

    stage: measures the time of a named stage. Raises InputError for components with different skeletons.
    """
    with stage("dataset"):
        clip = FrameCache(build(config.dataset))
    info = clip.info
    body: Body = build(config.body, info=info, clip=clip)
    with stage("prior_learning"):
        prior: Prior | None = None if config.prior is None else build(
            config.prior, frames_hz=info.rate_hz, trajectory=lambda: trajectory_of_keypoints(body.skeleton, clip)
        )  # fmt: skip
    _check_skeletons(info, body, prior)
    if body.skeleton.has_feet:
        _check_feet(config, clip)
    live = {"body": body, "clip": clip, "info": info, "phase_ends": info.phase_ends, "prior": prior}
    if ignored := ignores_likelihood(config):
        log.info("the likelihood is not built, as the inference does not use one")
    unused = ignored or config.likelihood is None
    likelihood: Likelihood | None = None if unused else build(config.likelihood, **live)
    inference: Inference = build(config.inference, likelihood=likelihood, **live)
    with stage("start"):
        start = None
        if info.initial_pose is not None or info.initial_annotations is not None or not inference.finds_start:
            start, message = initial_poses(prior, body, clip)
            if message:
                log.info(message)
    return Components(clip, body, prior, inference, start)


def _check_skeletons(info: SequenceInfo, body: Body, prior: Prior | None) -> None:
    """Raise InputError if dataset, body and prior have different skeletons."""
    if info.body is not None and info.body.skeleton.names != body.skeleton.names:
        raise InputError("body: dataset.skeleton=full has every joint of the motion file; choose body=dataset")
    if unknown := [name for name in (prior.parameters if prior else ()) if name not in body.skeleton.dof_names]:
        raise InputError(
            f"prior: the tracked body has no parameter {unknown[0]}; dataset.skeleton and prior.skeleton must be equal"
        )


def _check_feet(config: DictConfig, clip: FrameCache) -> None:
    """Raise InputError for feet with an inference other than a fit, whose prior moves the person's numbers alone, and
    with a dataset that knows the person's pose."""
    if FIT not in traits_of(config.inference).provides:
        raise InputError("body: skeleton=feet needs a fit, inference=least_squares; other inferences move no ankles")
    truth = next(iter(clip)).truth
    if clip.info.initial_pose is not None or (truth is not None and truth.pose is not None):
        raise InputError("body: skeleton=feet is for detected joints; the poses of this dataset have no ankles")


class Meter:
    """Errors of the steps of one run, computed in order; those of a body with feet are the errors without them."""

    def __init__(self, components: Components) -> None:
        self._body, self._scale, self._clip = components.body.without_feet, components.clip.info.scale, components.clip
        skeleton = self._body.skeleton
        self._parameters = tuple(name for name in components.parameters if name in skeleton.dof_names)
        self._acceleration = AccelerationError(skeleton, self._parameters)
        self._markers = MarkerOffsets(skeleton, self._parameters)
        self._first = True  # the initial pose, which is not tracked
        self._ranks: list[FloatArray] = []
        self._humaneva_mm: list[float] = []

    def errors(self, step: Step) -> dict[str, float]:
        """Return the step's errors by name, see `step_errors`, `AccelerationError`, `MarkerOffsets` and `group_errors`,
        and its expected errors, see `expected_errors` of `step_calibration`."""
        step = step.first_parameters(len(self._body.skeleton.dof_names))
        errors = step_errors(step, self._body, self._parameters, self._scale, self._initial)
        errors |= expected_errors(step, self._body.skeleton) | group_errors(step, self._body.skeleton)
        if not self._first:
            self._ranks.append(pose_ranks(step))
            truth = step.frame.truth
            if truth is not None and truth.virtual_markers is not None and "humaneva_mm" in errors:
                self._humaneva_mm.append(errors["humaneva_mm"])
        self._first = False
        return errors | self._acceleration.add(step) | self._markers.add(step)

    @cached_property
    def _initial(self) -> FloatArray | None:
        """The true pose (P,) in the first frame, None if it is unknown."""
        truth = next(iter(self._clip)).truth
        return None if truth is None else truth.pose

    @property
    def run_metrics(self) -> dict[str, float]:
        """Metrics of the run as a whole: lengths of the marker offsets, mm, the expected calibration error, see
        `posterior_calibration.expected_calibration_error`, and the deviation of HumanEva's error over its frames."""
        ranks = np.concatenate(self._ranks) if self._ranks else np.zeros(0)
        calibration = {"expected_calibration_error": expected_calibration_error(ranks)} if len(ranks) else {}
        deviation = {"humaneva_std_mm": float(np.std(self._humaneva_mm))} if self._humaneva_mm else {}
        return self._markers.corrected_mm | self._markers.lengths_mm | calibration | deviation


def track(components: Components, seed: int, meter: Meter | None = None) -> Iterator[tuple[Step, dict[str, float]]]:
    """Yield every frame's step with its errors, from `meter` or a new one.

    Raises InputError for a negative seed; exceptions of the components pass through.
    """
    meter = Meter(components) if meter is None else meter
    for step in components.inference.run(components.clip, components.start, rng_streams(seed)):
        yield step, meter.errors(step)
