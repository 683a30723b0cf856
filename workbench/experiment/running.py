"""What a run does: build the parts, track frame by frame, record, sum up."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from workbench.core.prior import Prior
from workbench.core.step import continues
from workbench.core.study import Study
from workbench.evaluation.evidence import Evidence
from workbench.evaluation.headline import ERRORS
from workbench.evaluation.verdict import WINDOW, verdict
from workbench.experiment.assembly import assemble
from workbench.experiment.config.assumptions import givens
from workbench.experiment.config.compatibility import no_evidence
from workbench.experiment.config.instantiate import build
from workbench.experiment.execute import Stop
from workbench.experiment.judging import constant, told
from workbench.experiment.summary import Summary, versions
from workbench.experiment.tracking import Meter, Parts, track
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams
from workbench.utils.signals import check_interrupted
from workbench.utils.timing import compiled_s, compiling, working_s

if TYPE_CHECKING:
    from workbench.experiment.continuing import Continued  # which reads recordings, as most runs do not

log = logging.getLogger(__name__)


def run(
    config: DictConfig, summary: Summary, names: Mapping[str, str], quiet: bool, continued: "Continued | None",
    stop: Stop | None,
) -> None:  # fmt: skip
    """Run a configuration that `execute` has checked, and count it in the summary; names: the options chosen, by
    group. The rest as there."""
    # one BLAS thread: its sums, and so a learned model's last bits, depend on how many there are
    with _threads(config.threads), threadpool_limits(limits=1, user_api="blas"), compiling(quiet):
        if config.study is None:
            config = _with_given(config, names)
            summary.given = list(config.given)
        summary.settings = _plain(config)
        if config.study is not None:
            _study(config, summary)
        else:
            _track(config, summary, names, quiet, continued, stop)


def _plain(config: DictConfig) -> dict[str, Any]:
    found: Any = OmegaConf.to_container(config, resolve=True)
    return found


def _with_given(config: DictConfig, names: Mapping[str, str]) -> DictConfig:
    """Put in what the run is given in place of what its experiment lists, and say both where they differ."""
    taken, listed = list(givens(config, names)), list(config.get("given") or [])
    log.info("given: %s", ", ".join(taken) or "nothing")
    if listed and listed != taken:
        log.info("the experiment as it stands lists: %s", ", ".join(listed))
    config = config.copy()
    OmegaConf.update(config, "given", taken, force_add=True)
    return config


def _track(
    config: DictConfig, summary: Summary, names: Mapping[str, str], quiet: bool, continued: "Continued | None",
    stop: Stop | None,
) -> None:  # fmt: skip
    parts = assemble(config, partial(_timed, summary), names)
    summary.counted = parts.clip.known.counted
    if reason := no_evidence(config, names):
        summary.left_out["log_evidence"] = reason
    summary.constant = constant(config, parts)
    evidence = Evidence(parts.body, parts.clip.known.scale)
    with recorder_of(config, parts, summary) as recorder:
        recorder.set_departures(parts.clip.known.departures)
        before_s = compiled_s()
        record(parts, recorder, int(config.seed), summary, quiet, continued, stop, evidence)
        summary.compiling_s = compiled_s() - before_s
        measured = evidence.measured()
        summary.verdict = verdict(measured, told(config, summary.settings, parts))
        recorder.set_verdict(summary.verdict, measured)
        recorder.set_result(summary.metrics)
        recorder.set_cost(summary.cost)


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
        summary.compiling_s = compiled_s() - before_s
        summary.study = result.metrics
        record_study(file, result)
        file.send_numbers("cost", summary.cost)


def record(
    parts: Parts, recorder: Recorder, seed: int, summary: Summary, quiet: bool,
    continued: "Continued | None" = None, stop: Stop | None = None, evidence: Evidence | None = None,
) -> None:  # fmt: skip
    """Track, or go on, record every step with its errors, and count it in the summary; quiet: no progress bar.
    evidence: takes in every step, too."""
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
                summary.left_out.setdefault("log_evidence", "this inference does not estimate it")
            told_evidence = {} if "log_evidence" in summary.left_out else {"log_evidence": step.log_evidence}
            with _timed(summary, "recording"):
                recorder.log(step, {**told_evidence, **errors})
            summary.add(step, errors)
            if evidence is not None:
                evidence.add(step, errors)
            for sentence in step.warnings:
                log.warning(sentence)
            shown = [f"error {errors[name]:.1f} {unit}" for name, unit in ERRORS.items() if name in errors][:1]
            sure = [] if "ess" in summary.constant else [f"ESS {step.ess:.0f}"]
            bar.set_postfix_str(", ".join([*shown, *sure]))
            bar.update()
            if stop is not None and summary.frames > WINDOW and stop(summary.metrics):  # before, one frame decides
                summary.stopped = f"{stop} in frame {step.frame.index}"
                recorder.set_stopped(summary.stopped)
                log.info("stopped: %s", summary.stopped)
                break
    summary.over_run = meter.over_run


def recorder_of(config: DictConfig, parts: Parts, summary: Summary) -> Recorder:
    """Build what records a run of these parts into `summary.recording`, not yet open; InputError as `Recorder`."""
    space = parts.inference.space
    n_coefficients = len(range(len(space))[space.slices.get("coefficients", slice(0))])
    scale = np.ones(n_coefficients)  # every prior counts them in standard deviations
    live = {
        "path": summary.recording,
        "constant": sorted(constant(config, parts)),
        "body": parts.body,
        "space": space,
        "coefficient_scale": scale,
    }
    live |= {"decode": parts.prior.pose} if parts.prior is not None and continues(parts.inference) else {}
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
            "given": ", ".join(summary.given),
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
