"""The live objects of a run, built from a configuration, and their steps with errors."""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from omegaconf import DictConfig

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.dataset import SequenceInfo
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import Likelihood
from workbench.core.prior import Prior
from workbench.core.step import Inference, Step
from workbench.evaluation.marker_offsets import MarkerOffsets
from workbench.evaluation.pose_errors import AccelerationError, step_errors
from workbench.evaluation.posterior_calibration import expected_calibration_error
from workbench.evaluation.step_calibration import expected_errors, group_errors, pose_ranks
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.requirements import check_requirements, ignores_likelihood
from workbench.inference.initialization.from_keypoints import trajectory_of_keypoints
from workbench.inference.initialization.poses import start_poses
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Parts:
    """The live objects of one run.

    prior: None where the inference does without. start: (P,) the first pose, (n, P) several that are as likely, or None
    where the inference finds it.
    """

    clip: FrameCache
    body: Body
    prior: Prior | None
    inference: Inference
    start: FloatArray | None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose's parameters that move."""
        return self.body.skeleton.dof_names if self.prior is None else self.prior.parameters


def assemble(config: DictConfig) -> Parts:
    """Check a configuration's requirements and build its parts; raises InputError as `check_requirements`."""
    check_requirements(config, {})
    return build_parts(config)


def build_parts(config: DictConfig, stage: Callable[[str], AbstractContextManager[Any]] = nullcontext) -> Parts:
    """Build dataset, body, prior, likelihood and inference, and find the starting pose.

    stage: measures the time of a named stage. Raises InputError for components that do not share one skeleton.
    """
    with stage("dataset"):
        clip = FrameCache(build(config.dataset))
    info = clip.info
    body: Body = build(config.body, info=info, clip=clip)
    with stage("prior_learning"):
        prior: Prior | None = None if config.prior is None else build(
            config.prior, camera=lambda: _only_camera(info), frames_hz=info.rate_hz,
            trajectory=lambda: trajectory_of_keypoints(body.skeleton, clip),
        )  # fmt: skip
    _check_skeletons(info, body, prior)
    live = {"body": body, "clip": clip, "info": info, "phase_ends": info.phase_ends, "prior": prior}
    if ignored := ignores_likelihood(config):
        log.info("the likelihood is not built: this inference looks at none")
    unused = ignored or config.likelihood is None
    likelihood: Likelihood | None = None if unused else build(config.likelihood, **live)
    inference: Inference = build(config.inference, likelihood=likelihood, **live)
    with stage("start"):
        start = None
        if info.initial_pose is not None or info.initial_annotations is not None or not inference.finds_start:
            start, sentence = start_poses(prior, body, clip)
            if sentence:
                log.info(sentence)
    return Parts(clip, body, prior, inference, start)


def _only_camera(info: SequenceInfo) -> Camera:
    if len(info.cameras) != 1:
        raise InputError(f"prior: limbs flip before one camera, found {len(info.cameras)}")
    return info.cameras[0]


def _check_skeletons(info: SequenceInfo, body: Body, prior: Prior | None) -> None:
    """Raise InputError where dataset, body and prior do not share one skeleton."""
    if info.body is not None and info.body.skeleton.names != body.skeleton.names:
        raise InputError("body: dataset.skeleton=full shows every joint of the motion file: choose body=dataset")
    if unknown := [name for name in (prior.parameters if prior else ()) if name not in body.skeleton.dof_names]:
        raise InputError(
            f"prior: it moves {unknown[0]}, which the tracked body does not have; dataset.skeleton and prior.skeleton "
            "must be the same"
        )


class Meter:
    """Measures the errors of the steps of one run, in their order."""

    def __init__(self, parts: Parts) -> None:
        self._body, self._parameters, self._scale = parts.body, parts.parameters, parts.clip.info.scale
        self._acceleration = AccelerationError(parts.body.skeleton, parts.parameters)
        self._markers = MarkerOffsets(parts.body.skeleton, parts.parameters)
        self._first = True  # given, not tracked
        self._ranks: list[FloatArray] = []

    def errors(self, step: Step) -> dict[str, float]:
        """The step's errors by name, see `step_errors`, `AccelerationError`, `MarkerOffsets` and `group_errors`, and
        the errors that its posterior expects, see `expected_errors`."""
        errors = step_errors(step, self._body, self._parameters, self._scale)
        errors |= expected_errors(step, self._body.skeleton) | group_errors(step, self._body.skeleton)
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
    def run_metrics(self) -> dict[str, float]:
        """Metrics of the whole run: errors with markers' offsets corrected, lengths of these offsets, and the expected
        calibration error, see `posterior_calibration.expected_calibration_error`."""
        ranks = np.concatenate(self._ranks) if self._ranks else np.zeros(0)
        calibration = {"expected_calibration_error": expected_calibration_error(ranks)} if len(ranks) else {}
        return self._markers.corrected_mm | self._markers.lengths_mm | calibration


def track(parts: Parts, seed: int, meter: Meter | None = None) -> Iterator[tuple[Step, dict[str, float]]]:
    """Every frame's step with its errors, by the meter given or one of its own.

    Raises InputError for a negative seed and what the parts raise.
    """
    meter = Meter(parts) if meter is None else meter
    for step in parts.inference.run(parts.clip, parts.start, rng_streams(seed)):
        yield step, meter.errors(step)
