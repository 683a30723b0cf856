"""One run: check the configuration, build the components, track frame by frame, record and summarize."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from workbench.body.angles import FLEXIONS
from workbench.cameras.camera_motion import TRAVELLING, TURNING
from workbench.core.capabilities import FIT, IMAGES, KEYPOINTS, POINTS, UNIFORM_WEIGHTS
from workbench.core.prior import Prior
from workbench.core.study import Study
from workbench.detections.detector.detection_files import detected_s
from workbench.evaluation.metrics import HEADLINE_ERRORS, row_of
from workbench.evaluation.verdict.run_findings import RunInputs
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import verdict
from workbench.experiment.config.instantiate import build, check_targets
from workbench.experiment.config.options import GROUPS
from workbench.experiment.config.requirements import assumptions, check_requirements, evidence_problem, traits_of
from workbench.experiment.provenance import Command, identity, provenance
from workbench.experiment.summary import Summary, set_aside, versions
from workbench.experiment.tracking import Components, Meter, build_components, track
from workbench.recording.write.recorder import Recorder
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_sizes
from workbench.utils.parallel import single_blas_thread
from workbench.utils.rng import rng_streams
from workbench.utils.run_files import RECORDING, SUMMARY
from workbench.utils.run_lock import run_folder
from workbench.utils.signals import check_interrupted, deferred, interruptible
from workbench.utils.timing import compiled_s, compiling, on_one_stack, working_s

log = logging.getLogger(__name__)

_Stop = Callable[[Mapping[str, float]], bool]
"""Condition on the metrics so far that ends a run; its text is the condition."""


def execute(
    config: DictConfig, experiment: str, folder: Path, quiet: bool = False, command: Command | None = None,
    stop: _Stop | None = None,
) -> Summary:  # fmt: skip
    """Run the configured experiment and write `run.rrd` and `summary.json` in `folder`, which is created and locked.

    Parameters
    ----------
    config : the configuration, not yet resolved.
    experiment : name to record.
    folder : the run's folder.
    quiet : show no progress bar.
    command : the command to record; error messages contain its choices.
    stop : condition that ends the run early.

    Raises
    ------
    InputError : bad input.
    DegenerateWeights : all weights vanish and the configuration asks for an error; the frames before are in
        `run.rrd.part`.
    """
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / RECORDING)
    with run_folder(folder), ending(summary):
        run_checked(config, summary, quiet, command or Command(), stop)
    return summary


@contextmanager
def ending(summary: Summary) -> Iterator[None]:
    """Write summary.json at the beginning and at the end of a run; SIGINT, SIGTERM and SIGHUP interrupt the block.

    The caller holds the lock of the run's folder. A complete run in it is moved to EARLIER. Once the recording is
    published the run counts as complete, also if it is interrupted or fails afterwards.
    """
    path = summary.recording.parent / SUMMARY
    set_aside(path.parent)
    with interruptible():
        try:
            summary.write(path)  # status "running", which remains after a kill
            yield
            _end(summary, path, None)
        except BaseException as error:
            _end(summary, path, error)  # again if interrupted during `_end` above
            raise


def _end(summary: Summary, path: Path, error: BaseException | None) -> None:
    with deferred():
        summary.end(error)
        summary.write(path)


def run_checked(config: DictConfig, summary: Summary, quiet: bool, command: Command, stop: _Stop | None) -> None:
    """Check and run the configuration, and fill the summary; parameters and errors as of `execute`."""
    config = config.copy()
    OmegaConf.resolve(config)  # once, as parsing interpolations is slow
    _check(config, command.choices)
    summary.identity, summary.provenance = identity(config), provenance(config, command)
    with _thread_count(config.n_threads), single_blas_thread(), compiling(quiet):
        if config.study is None:
            summary.assumptions = assumptions(config)
            log.info("assumptions: %s", ", ".join(summary.assumptions) or "nothing")
            OmegaConf.update(config, "assumptions", summary.assumptions, force_add=True)
        summary.settings = _plain(config)
        if config.study is not None:
            on_one_stack(lambda: _study(config, summary))
        else:
            on_one_stack(lambda: _track(config, summary, command.choices, quiet, stop))


def _check(config: DictConfig, names: Mapping[str, str]) -> None:
    """Raise InputError for an invalid configuration, before anything is built."""
    for group in GROUPS:
        node = config.get(group)
        if node is not None and not (isinstance(node, DictConfig) and isinstance(node.get("_target_"), str)):
            value = "nothing" if isinstance(node, DictConfig) and not len(node) else repr(node)
            raise InputError(
                f"config: {group}: expected a component with a _target_, found {value}; choose an option, "
                f"{group}=NAME, or write {group}: null"
            )
    plain = _plain(config)
    check_targets(config)
    check_sizes(plain)
    rng_streams(int(config.seed))  # raises for a negative seed
    if config.study is None:
        check_requirements(config, names)


def _plain(config: DictConfig) -> dict[str, Any]:
    plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    return plain


def _track(config: DictConfig, summary: Summary, names: Mapping[str, str], quiet: bool, stop: _Stop | None) -> None:
    before_s = detected_s()
    components = build_components(config, partial(_timed, summary))
    if (detection_s := detected_s() - before_s) > 0.0:
        summary.timing["detection"] = detection_s
    summary.input_counts = components.clip.info.input_counts
    if reason := evidence_problem(config, names):
        summary.omitted_metrics["log_evidence"] = reason
    summary.uninformative_metrics = _uninformative(config, components)
    collector = MeasurementCollector(components.body, components.clip.info.scale)
    with recorder_of(config, components, summary) as recorder:
        before_s = compiled_s()
        record(components, recorder, int(config.seed), summary, quiet, stop, collector)
        summary.compile_s = compiled_s() - before_s
        measured = collector.measurements()
        summary.verdict = verdict(measured, run_inputs(config, summary.settings, components))
        recorder.set_verdict(summary.verdict, measured)
        recorder.set_result(summary.metrics)
        recorder.set_cost(summary.cost)


def run_inputs(config: DictConfig, settings: Mapping[str, Any], components: Components) -> RunInputs:
    """Return the inputs of a run that its frames may contradict; settings: the resolved configuration."""
    info, body = components.clip.info, settings.get("body") or {}
    return RunInputs(
        height_m=body.get("height_m"),
        rate_hz=info.rate_hz,
        source_rate_hz=info.source_rate_hz,
        shows_person=bool(traits_of(config.dataset).provides & {IMAGES, KEYPOINTS, POINTS}),
        input_counts=info.input_counts,
        camera_travels=info.camera_motion == TRAVELLING,
    )


def _uninformative(config: DictConfig, components: Components) -> frozenset[str]:
    """Return the metrics that are equal in every run of such components.

    These are the metrics of uniform weights (also for a uniform likelihood), the metrics of the heaviest particle for
    a fit, and the flexion errors of legs that do not move.
    """
    provided = traits_of(config.inference).provides
    of_likelihood = frozenset() if config.likelihood is None else traits_of(config.likelihood).provides
    names = {"ess", "ess_mean"} if UNIFORM_WEIGHTS in provided | of_likelihood else set()
    names |= {f"{error}_max_weight" for error in HEADLINE_ERRORS} if FIT in provided else set()
    for joint in ("knee", "hip"):
        angles = {angle for name, signs in FLEXIONS.items() if name.endswith(joint) for angle in signs}
        names |= set() if angles & set(components.parameters) else {f"{joint}_flexion_rmse_deg"}
    return frozenset(names)


def _study(config: DictConfig, summary: Summary) -> None:
    from workbench.recording.study.study_recorder import record_study  # imported here, as it is slow
    from workbench.recording.write.file import RecordingFile

    prior: Prior | None = None
    if config.prior is not None:
        with _timed(summary, "prior_learning"):
            prior = build(config.prior)
    study: Study = build(config.study, prior=prior)
    with RecordingFile(summary.recording, **_labels(config, summary)) as file:
        before_s = compiled_s()
        with _timed(summary, "study"):
            result = study.run(rng_streams(int(config.seed))["study"])
        summary.compile_s = compiled_s() - before_s
        summary.study = result.metrics
        record_study(file, result)
        file.send_numbers("cost", summary.cost)


def record(
    components: Components, recorder: Recorder, seed: int, summary: Summary, quiet: bool,
    stop: _Stop | None = None, collector: MeasurementCollector | None = None,
) -> None:  # fmt: skip
    """Track, record every step with its errors, and add it to the summary and the run evidence.

    Parameters
    ----------
    components, recorder, seed, summary : the run; the recorder is open.
    quiet : show no progress bar.
    stop : as of `execute`.
    collector : of measurements for the verdict.
    """
    recorder.set_perturbations(components.clip.info.perturbations)
    meter, disable = Meter(components), True if quiet else None
    redirected = logging_redirect_tqdm(loggers=[] if quiet else None)  # an empty list: a quiet run logs nothing here
    with redirected, tqdm(total=len(components.clip), unit="frame", disable=disable) as bar:
        for step, errors in track(components, seed, meter):
            check_interrupted()
            if not np.isfinite(step.log_evidence):
                summary.omitted_metrics.setdefault("log_evidence", "this inference does not estimate it")
            numbers = {} if "log_evidence" in summary.omitted_metrics else {"log_evidence": step.log_evidence}
            with deferred():  # an interruption leaves the same frames in both
                with _timed(summary, "recording"):
                    recorder.log(step, {**numbers, **errors})
                summary.add(step, errors)
                if recorder.n_flushed == summary.frames:  # a kill does, too
                    summary.write(summary.recording.parent / SUMMARY)
            if collector is not None:
                collector.add(step, errors)
            for message in step.warnings:
                log.warning(message)
            error = [f"error {errors[name]:.1f} {row_of(name).unit}" for name in HEADLINE_ERRORS if name in errors][:1]
            ess = [] if "ess" in summary.uninformative_metrics else [f"ESS {step.ess:.0f}"]
            bar.set_postfix_str(", ".join([*error, *ess]), refresh=False)  # shown by the update
            bar.update()
            if stop is not None and summary.frames > WINDOW_FRAMES and stop(summary.metrics):  # not by a few frames
                summary.stopped = f"{stop} in frame {step.frame.index}"
                recorder.set_stopped(summary.stopped)
                log.info("stopped: %s", summary.stopped)
                break
    summary.run_metrics = meter.run_metrics


def recorder_of(config: DictConfig, components: Components, summary: Summary) -> Recorder:
    """Return the recorder of a run of these components, not yet open; InputError as `Recorder`.

    It does not show the summary's uninformative metrics.
    """
    live = {"path": summary.recording, "body": components.body, "space": components.inference.space}
    live |= {"source_video": components.clip.info.video, "camera_turns": components.clip.info.camera_motion == TURNING}
    live |= {"uninformative_metrics": sorted(summary.uninformative_metrics)}
    recorder: Recorder = build(config.recorder, **live, **_labels(config, summary))
    return recorder


def _labels(config: DictConfig, summary: Summary) -> dict[str, Any]:
    """Return the recording's id, configuration and provenance."""
    return {
        "run_id": f"{summary.experiment}-{summary.started}-{summary.seed}",
        "config_yaml": OmegaConf.to_yaml(config, resolve=True),
        "settings": _plain(config),
        "provenance": {
            "experiment": summary.experiment,
            "seed": summary.seed,
            "assumptions": ", ".join(summary.assumptions),
            "identity": summary.identity or "",
            **summary.provenance,
            **versions(),
        },
    }


@contextmanager
def _thread_count(n_threads: int | None) -> Iterator[None]:
    """Set the number of kernel threads for the block; None: the number of cores."""
    maximum, before = int(numba.config.NUMBA_NUM_THREADS), numba.get_num_threads()  # type: ignore[attr-defined]
    if n_threads is not None and not 1 <= n_threads <= maximum:
        raise InputError(f"n_threads: expected 1 to {maximum}, the number of cores, found {n_threads}")
    numba.set_num_threads(maximum if n_threads is None else n_threads)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def _timed(summary: Summary, stage: str) -> Iterator[None]:
    began = working_s()
    try:
        yield
    finally:
        summary.timing[stage] = summary.timing.get(stage, 0.0) + working_s() - began
