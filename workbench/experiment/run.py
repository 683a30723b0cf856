"""One run: check the configuration, build the components, track frame by frame, record and sum up."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from workbench.body.angles import FLEXIONS
from workbench.core.capabilities import FIT, IMAGES, KEYPOINTS, POINTS, UNIFORM_WEIGHTS
from workbench.core.prior import Prior
from workbench.core.step import resumable
from workbench.core.study import Study
from workbench.evaluation.headline import ERRORS
from workbench.evaluation.run_measurements import MeasurementCollector
from workbench.evaluation.track_loss import WINDOW_FRAMES
from workbench.evaluation.verdict import RunInputs, verdict
from workbench.experiment.config.instantiate import build, check_targets
from workbench.experiment.config.options import GROUPS
from workbench.experiment.config.requirements import assumptions, check_requirements, no_evidence, traits_of
from workbench.experiment.provenance import Command, identity, provenance
from workbench.experiment.resume import Continued
from workbench.experiment.summary import Summary, set_aside, versions
from workbench.experiment.tracking import Meter, Parts, build_parts, track
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_products, check_sizes
from workbench.utils.rng import rng_streams
from workbench.utils.run_files import RECORDING, SUMMARY
from workbench.utils.run_lock import run_folder
from workbench.utils.signals import check_interrupted, deferred, interruptible
from workbench.utils.timing import compiled_s, compiling, working_s

log = logging.getLogger(__name__)

_Stop = Callable[[Mapping[str, float]], bool]
"""Whether a run ends, by its numbers so far; as text it is the condition."""


def execute(
    config: DictConfig, experiment: str, folder: Path, quiet: bool = False, command: Command | None = None,
    continued: Continued | None = None, stop: _Stop | None = None,
) -> Summary:  # fmt: skip
    """Run the configured experiment and leave `run.rrd` and `summary.json` in `folder`, which it makes and locks.

    Parameters
    ----------
    config, experiment
        The resolvable configuration, and the name to record for it.
    command
        What was said, which is recorded; error messages name its choices.
    continued, stop
        Where a recorded run goes on, None for the first frame; a condition that ends the run.

    Raises
    ------
    InputError
        For what a user can mend.
    DegenerateWeights
        Where the configuration asks to end there: the recording up to there is kept as `run.rrd.part`.
    """
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / RECORDING)
    with run_folder(folder), ending(summary):
        run_checked(config, summary, quiet, command or Command(), continued, stop)
    return summary


@contextmanager
def ending(summary: Summary) -> Iterator[None]:
    """Write summary.json at the beginning of a run and, with how it ended, at its end; SIGTERM and its like interrupt.

    The caller holds the lock of the run's folder. A complete run in it is set aside. The recording decides: once it is
    published the run is complete, whatever is asked for or fails from there on.
    """
    path = summary.recording.parent / SUMMARY
    set_aside(path.parent)
    with interruptible():
        try:
            summary.write(path)  # "running", which is what a killed run leaves
            yield
            _end(summary, path, None)
        except BaseException as error:
            _end(summary, path, error)  # once more, where it was asked to end while it was about to do that
            raise


def _end(summary: Summary, path: Path, error: BaseException | None) -> None:
    with deferred():
        summary.end(error)
        summary.write(path)


def run_checked(
    config: DictConfig, summary: Summary, quiet: bool, command: Command, continued: Continued | None,
    stop: _Stop | None,
) -> None:  # fmt: skip
    """Check the configuration and run it, counted in the summary; parameters and errors as of `execute`."""
    _check(config, command.choices)
    summary.identity, summary.provenance = identity(config), provenance(config, command)
    if continued is not None:
        summary.identity = continued.identity(summary.identity)
        summary.provenance = {**summary.provenance, **continued.provenance}
    # one BLAS thread: its sums, and so a learned model's last bits, depend on how many there are
    with _threads(config.threads), threadpool_limits(limits=1, user_api="blas"), compiling(quiet):
        if config.study is None:
            config = _with_assumptions(config)
            summary.assumptions = list(config.assumptions)
        summary.settings = _plain(config)
        if config.study is not None:
            _study(config, summary)
        else:
            _track(config, summary, command.choices, quiet, continued, stop)


def _check(config: DictConfig, names: Mapping[str, str]) -> None:
    """Raise InputError for a configuration that no run can have; nothing is built."""
    for group in GROUPS:
        node = config.get(group)
        if node is not None and not (isinstance(node, DictConfig) and isinstance(node.get("_target_"), str)):
            found = "nothing" if isinstance(node, DictConfig) and not len(node) else repr(node)
            raise InputError(
                f"config: {group}: expected a component with a _target_, found {found}; choose an option, "
                f"{group}=NAME, or write {group}: null"
            )
    plain = _plain(config)
    check_targets(config)
    check_sizes(plain)
    check_products(plain)
    rng_streams(int(config.seed))  # which a wrong seed has none of
    if config.study is None:
        check_requirements(config, names)


def _plain(config: DictConfig) -> dict[str, Any]:
    found: Any = OmegaConf.to_container(config, resolve=True)
    return found


def _with_assumptions(config: DictConfig) -> DictConfig:
    """Put the side information that the run uses in place of what its experiment lists, and log both."""
    taken, listed = assumptions(config), list(config.get("assumptions") or [])
    log.info("assumptions: %s", ", ".join(taken) or "nothing")
    if listed and listed != taken:
        log.info("the experiment as it stands lists: %s", ", ".join(listed))
    config = config.copy()
    OmegaConf.update(config, "assumptions", taken, force_add=True)
    return config


def _track(
    config: DictConfig, summary: Summary, names: Mapping[str, str], quiet: bool, continued: Continued | None,
    stop: _Stop | None,
) -> None:  # fmt: skip
    parts = build_parts(config, partial(_timed, summary))
    summary.input_counts = parts.clip.info.counted
    if reason := no_evidence(config, names):
        summary.omitted_metrics["log_evidence"] = reason
    summary.uninformative_metrics = _uninformative(config, parts)
    collector = MeasurementCollector(parts.body, parts.clip.info.scale)
    with recorder_of(config, parts, summary) as recorder:
        before_s = compiled_s()
        record(parts, recorder, int(config.seed), summary, quiet, continued, stop, collector)
        summary.compile_s = compiled_s() - before_s
        measured = collector.measurements()
        summary.verdict = verdict(measured, _run_inputs(config, summary.settings, parts))
        recorder.set_verdict(summary.verdict, measured)
        recorder.set_result(summary.metrics)
        recorder.set_cost(summary.cost)


def _run_inputs(config: DictConfig, settings: Mapping[str, Any], parts: Parts) -> RunInputs:
    """Collect what a run was given that its frames may contradict; settings: the configuration, resolved."""
    info, body = parts.clip.info, settings.get("body") or {}
    iterations = (settings.get("inference") or {}).get("max_iterations")
    return RunInputs(
        height_m=body.get("height_m"),
        max_iterations=float(iterations) if isinstance(iterations, int) else None,
        rate_hz=info.rate_hz,
        source_rate_hz=info.source_rate_hz,
        shows_person=bool(traits_of(config.dataset).provides & {IMAGES, KEYPOINTS, POINTS}),
    )


def _uninformative(config: DictConfig, parts: Parts) -> frozenset[str]:
    """Return the metrics that are equal in every run of such components: those of uniform weights, also with a
    likelihood without observations, and, of a fit, the flexion of legs that do not move."""
    offers = traits_of(config.inference).provides
    seen = frozenset() if config.likelihood is None else traits_of(config.likelihood).provides
    names = {"ess", "ess_mean"} if UNIFORM_WEIGHTS in offers | seen else set()
    names |= {f"{error}_max_weight" for error in ("mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px")} if FIT in offers else set()
    for joint in ("knee", "hip"):
        angles = {angle for name, signs in FLEXIONS.items() if name.endswith(joint) for angle in signs}
        names |= set() if angles & set(parts.parameters) else {f"{joint}_flexion_rmse_deg"}
    return frozenset(names)


def _study(config: DictConfig, summary: Summary) -> None:
    from workbench.recording.study.study_recorder import record_study  # here, since drawing takes long to import
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
    parts: Parts, recorder: Recorder, seed: int, summary: Summary, quiet: bool,
    continued: Continued | None = None, stop: _Stop | None = None, collector: MeasurementCollector | None = None,
) -> None:  # fmt: skip
    """Track, or go on, record every step with its errors, and count it in the summary; quiet: no progress bar.
    collector: takes in every step, too."""
    recorder.set_perturbations(parts.clip.info.departures)
    meter, disable = Meter(parts), True if quiet else None
    n_frames = len(parts.clip) - (0 if continued is None else continued.skipped)
    tracked = track(parts, seed, meter) if continued is None else continued.track(parts, seed, meter, recorder)
    if continued is not None and (earlier := continued.earlier) is not None:
        summary.take_over(len(earlier.frames), earlier.per_frame)
    redirected = logging_redirect_tqdm(loggers=[] if quiet else None)  # which would show a quiet run's log
    with redirected, tqdm(total=n_frames, unit="frame", disable=disable) as bar:
        for step, errors in tracked:
            check_interrupted()
            if not np.isfinite(step.log_evidence):
                summary.omitted_metrics.setdefault("log_evidence", "this inference does not estimate it")
            numbers = {} if "log_evidence" in summary.omitted_metrics else {"log_evidence": step.log_evidence}
            with _timed(summary, "recording"):
                recorder.log(step, {**numbers, **errors})
            summary.add(step, errors)
            if collector is not None:
                collector.add(step, errors)
            for message in step.warnings:
                log.warning(message)
            shown = [f"error {errors[name]:.1f} {unit}" for name, unit in ERRORS.items() if name in errors][:1]
            sure = [] if "ess" in summary.uninformative_metrics else [f"ESS {step.ess:.0f}"]
            bar.set_postfix_str(", ".join([*shown, *sure]))
            bar.update()
            if (
                stop is not None and summary.frames > WINDOW_FRAMES and stop(summary.metrics)
            ):  # before, one frame decides
                summary.stopped = f"{stop} in frame {step.frame.index}"
                recorder.set_stopped(summary.stopped)
                log.info("stopped: %s", summary.stopped)
                break
    summary.run_metrics = meter.run_metrics


def recorder_of(config: DictConfig, parts: Parts, summary: Summary) -> Recorder:
    """Build what records a run of these parts into `summary.recording`, not yet open; InputError as `Recorder`."""
    live = {"path": summary.recording, "body": parts.body, "space": parts.inference.space}
    live |= {"uninformative_metrics": sorted(_uninformative(config, parts))}
    live |= {"decode": parts.prior.pose} if parts.prior is not None and resumable(parts.inference) else {}
    recorder: Recorder = build(config.recorder, **live, **_labels(config, summary))
    return recorder


def _labels(config: DictConfig, summary: Summary) -> dict[str, Any]:
    """Return what a recording says about its run."""
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
def _threads(threads: int | None) -> Iterator[None]:
    """Have kernels use so many threads in the block; None: as many as there are cores."""
    most, before = int(numba.config.NUMBA_NUM_THREADS), numba.get_num_threads()  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= most:
        raise InputError(f"threads must lie between 1 and {most}, the number of cores, found {threads}")
    numba.set_num_threads(most if threads is None else threads)
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
