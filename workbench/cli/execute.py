"""One run: build the parts, track frame by frame, record, sum up."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.cli.build import build, check_targets
from workbench.cli.identity import identity
from workbench.cli.summary import Summary, versions
from workbench.datasets.blank import Blank
from workbench.datasets.frame import Dataset
from workbench.errors import InputError
from workbench.evaluation.errors import AccelerationError, step_errors
from workbench.evaluation.marker_offsets import MarkerOffsets
from workbench.inference.hybrid import Hybrid
from workbench.inference.inference import Inference
from workbench.inference.keypoint_start import start_from_keypoints
from workbench.inference.keypoint_trajectory import trajectory_of_keypoints
from workbench.inference.least_squares import LeastSquares
from workbench.inference.start import start_from_marks
from workbench.inference.step import Step
from workbench.priors.activity import Activity
from workbench.priors.cyclic import Cyclic
from workbench.priors.flipping import Flipping
from workbench.priors.following import Following
from workbench.priors.jitter import Jitter
from workbench.priors.state import Prior
from workbench.recording.recorder import Recorder
from workbench.recording.study import StudyRecorder
from workbench.studies.study import Study

log = logging.getLogger(__name__)

STREAMS = ("start", "resampling", "prior", "study")
"""Names of the run's random streams, spawned from its seed in this order."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The live objects of one run."""

    dataset: Dataset
    body: Body
    prior: Prior
    inference: Inference
    start: FloatArray | None


def execute(config: DictConfig, experiment: str, folder: Path, quiet: bool = False) -> Summary:
    """Run the configured experiment and leave `run.rrd` and `summary.json` in `folder`.

    quiet: no progress bar. Raises InputError for what a person can mend, DegenerateWeights where the configuration
    asks to end there; summary.json then says so, and the recording up to there is kept as `run.rrd.part`.
    """
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / "run.rrd")
    summary.write(folder / "summary.json")  # "running", which is how a run that is killed is told
    try:
        check_targets(config)
        summary.identity = identity(config)
        _set_threads(config.threads)
        # one BLAS thread: its sums, and so a learned model's last bits, depend on how many there are
        with threadpool_limits(limits=1, user_api="blas"):
            if config.study is not None:
                _study(config, summary)
            else:
                parts = assemble(config, summary)
                with recorder_of(config, parts, summary) as recorder:
                    track(parts, recorder, config, summary, quiet)
                    recorder.set_result(summary.metrics)
                    recorder.set_cost(summary.cost)
        summary.status = "complete"
    except BaseException as error:
        summary.status = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
        summary.error = f"{type(error).__name__}: {error}"
        raise
    finally:
        summary.write(folder / "summary.json")
    return summary


def _study(config: DictConfig, summary: Summary) -> None:
    prior: Prior | None = None
    if config.prior is not None:
        with _timed(summary, "prior_learning"):
            prior = build(config.prior)
    study: Study = build(config.study, prior=prior)
    with StudyRecorder(summary.recording, **_labels(config, summary)) as recorder:
        with _timed(summary, "study"):
            result = study.run(rng_streams(int(config.seed))["study"])
        summary.study = result.metrics
        recorder.log(result)
        recorder.set_cost(summary.cost)


def assemble(config: DictConfig, summary: Summary) -> Parts:
    """Build dataset, body, prior, likelihood and inference, and find the starting pose.

    Raises InputError when the configuration leaves one of them out.
    """
    if lacking := [name for name in ("dataset", "body", "prior", "likelihood", "inference") if config[name] is None]:
        raise InputError(f"config: expected a {lacking[0]} to track with, found none")
    with _timed(summary, "dataset"):
        dataset: Dataset = build(config.dataset)
    full_body: Body | None = getattr(dataset, "full_body", None)
    body: Body = build(config.body, dataset_shape=dataset.shape, full_body=full_body, dataset=dataset)
    with _timed(summary, "prior_learning"):
        prior: Prior = build(
            config.prior,
            camera=lambda: _camera(dataset),
            trajectory=lambda: trajectory_of_keypoints(body.skeleton, dataset.frames()),
        )
    _check_skeletons(full_body, body, prior)
    likelihood = build(config.likelihood, body=body, dataset=dataset)
    live = {
        "prior": prior,
        "likelihood": likelihood,
        "body": body,
        "lead_in": dataset.lead_in if isinstance(dataset, Blank) else None,
        "model": prior.model if isinstance(prior, Activity) else None,
        "phase_ends": getattr(dataset, "phase_ends", None),
    }
    inference: Inference = build(config.inference, **live)
    with _timed(summary, "start"):
        start = (
            None if isinstance(inference, LeastSquares | Hybrid) and _unknown(dataset) else _start(dataset, body, prior)
        )
    return Parts(dataset, body, prior, inference, start)


def _check_skeletons(full_body: Body | None, body: Body, prior: Prior) -> None:
    """Raise InputError where dataset, body and prior do not speak of one skeleton."""
    if full_body is not None and full_body.skeleton.names != body.skeleton.names:
        raise InputError("body: dataset.skeleton=full shows every joint of the motion file: choose body=dataset")
    if unknown := [name for name in prior.parameters if name not in body.skeleton.dof_names]:
        raise InputError(
            f"prior: it moves {unknown[0]}, which the tracked body does not have; dataset.skeleton and prior.skeleton "
            "must be the same"
        )


def _unknown(dataset: Dataset) -> bool:
    return dataset.start_pose is None and dataset.start_marks is None


def _camera(dataset: Dataset) -> Camera:
    """The one camera of the first frame."""
    views = next(iter(dataset.frames())).views
    if len(views) != 1:
        raise InputError(f"prior: limbs flip before one camera, found {len(views)}")
    return views[0].camera


def _start(dataset: Dataset, body: Body, prior: Prior) -> FloatArray:
    """The first pose (P,), or several (n, P) that keypoints allow."""
    if isinstance(prior, Following):
        first: FloatArray = prior.trajectory.poses[0]
        return first
    if dataset.start_pose is not None:
        return dataset.start_pose
    if dataset.start_marks is None and any(view.keypoints is not None for view in next(dataset.frames()).views):
        poses = start_from_keypoints(body.skeleton, dataset.frames())
        log.info("start fitted to keypoints: %d poses that they allow", len(poses))
        return poses
    if dataset.start_marks is None:
        raise InputError(
            "dataset: no starting pose: mark joints of the first frame of a video (dataset.start_marks=FILE.csv), give "
            "the start of points (dataset.start=given), or fit by inference=least_squares, which finds it"
        )
    if isinstance(prior, Jitter | Flipping):
        return _start(dataset, body, prior.base)
    if not isinstance(prior, Cyclic):
        raise InputError("prior: a start from marked joints needs a cyclic prior, such as prior=walking")
    camera = next(iter(dataset.frames())).views[0].camera
    fit = start_from_marks(prior, body.skeleton, camera, dataset.start_marks)
    pace = "" if np.isnan(fit.rate_hz) else f", {fit.rate_hz:.2f} cycles/s"
    log.info(
        "start fitted to the marks: %.1f px left, phase %.2f, heading %.0f°%s",
        fit.error_px / dataset.scale, fit.phase, np.degrees(fit.heading), pace,
    )  # fmt: skip
    return fit.pose


def track(parts: Parts, recorder: Recorder, config: DictConfig, summary: Summary, quiet: bool) -> None:
    """Track frame by frame, measure and record every step, and count it in the summary; quiet: no progress bar."""
    streams = rng_streams(int(config.seed))
    steps = parts.inference.run(parts.dataset.frames(), parts.start, streams)
    disable = True if quiet else None
    shaking = AccelerationError(parts.body.skeleton, parts.prior.parameters)
    markers = MarkerOffsets(parts.body.skeleton, parts.prior.parameters)
    with logging_redirect_tqdm(), tqdm(total=len(parts.dataset), unit="frame", disable=disable) as bar:
        for step in steps:
            errors = step_errors(step, parts.body, parts.prior.parameters, parts.dataset.scale)
            errors |= shaking.add(step) | markers.add(step)
            with _timed(summary, "recording"):
                recorder.log(step, errors)
            summary.add(step, errors)
            for sentence in step.warnings:
                log.warning(sentence)
            bar.set_postfix_str(_postfix(step, errors))
            bar.update()
    summary.offsets = markers.lengths_mm


def _postfix(step: Step, errors: dict[str, float]) -> str:
    shown = [f"ESS {step.ess:.0f}"]
    if "error_abs_mm" in errors:
        shown.insert(0, f"error {errors['error_abs_mm']:.0f} mm")
    elif "error_px" in errors:
        shown.insert(0, f"error {errors['error_px']:.1f} px")
    return ", ".join(shown)


def recorder_of(config: DictConfig, parts: Parts, summary: Summary) -> Recorder:
    """What records a run of these parts into `summary.recording`, not yet open; InputError for numbers out of range."""
    space = parts.inference.space
    coefficients = range(len(space))[space.slices.get("coefficients", slice(0))]
    recorder: Recorder = build(
        config.recorder,
        path=summary.recording,
        body=parts.body,
        space=space,
        coefficient_scale=np.ones(len(coefficients)),  # every prior counts them in standard deviations
        **_labels(config, summary),
    )
    return recorder


def _labels(config: DictConfig, summary: Summary) -> dict[str, Any]:
    """What a recording says about its run."""
    return {
        "run_id": f"{summary.experiment}-{summary.started}-{summary.seed}",
        "config_yaml": OmegaConf.to_yaml(config, resolve=True),
        "provenance": {"experiment": summary.experiment, "seed": summary.seed, **versions()},
    }


def rng_streams(seed: int) -> dict[str, np.random.Generator]:
    """The run's named random streams; raises InputError for a negative seed."""
    if seed < 0:
        raise InputError(f"seed must be zero or a positive whole number, found {seed}")
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)}


def _set_threads(threads: int | None) -> None:
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= most:
        raise InputError(f"threads must lie between 1 and {most}, the number of cores, found {threads}")
    numba.set_num_threads(most if threads is None else threads)  # a job before this one may have set it


@contextmanager
def _timed(summary: Summary, stage: str) -> Iterator[None]:
    began = perf_counter()
    try:
        yield
    finally:
        summary.timing[stage] = summary.timing.get(stage, 0.0) + perf_counter() - began
