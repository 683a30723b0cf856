"""One run: build the parts, track frame by frame, record, sum up."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numba
import numpy as np
from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from workbench.core.prior import Prior
from workbench.core.study import Study
from workbench.errors import InputError
from workbench.experiment.assembly import assemble
from workbench.experiment.build import build, check_targets
from workbench.experiment.compatibility import no_evidence
from workbench.experiment.given import givens
from workbench.experiment.identity import identity
from workbench.experiment.provenance import Command, provenance
from workbench.experiment.summary import Summary, versions
from workbench.experiment.tracking import Meter, Parts, rng_streams, track
from workbench.recording.study.recorder import record_study
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.recorder import Recorder

log = logging.getLogger(__name__)
_SHOWN = {"error_abs_mm": "error {:.0f} mm", "error_px": "error {:.1f} px"}  # beside the progress bar, the first


def execute(
    config: DictConfig, experiment: str, folder: Path, quiet: bool = False, command: Command | None = None
) -> Summary:
    """Run the configured experiment and leave `run.rrd` and `summary.json` in `folder`.

    quiet: no progress bar. command: what was said, which is recorded; sentences name its choices. Raises InputError for
    what a person can mend, DegenerateWeights where the configuration asks to end there; summary.json then says so, and
    the recording up to there is kept as `run.rrd.part`.
    """
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / "run.rrd")
    command = command or Command()
    names: Mapping[str, str] = command.choices
    summary.write(folder / "summary.json")  # "running", which is how a run that is killed is told
    try:
        check_targets(config)
        summary.identity, summary.provenance = identity(config), provenance(config, command)
        _set_threads(config.threads)
        # one BLAS thread: its sums, and so a learned model's last bits, depend on how many there are
        with threadpool_limits(limits=1, user_api="blas"):
            if config.study is None:
                config = _with_given(config, names)
                summary.given = list(config.given)
            summary.settings = _plain(config)
            if config.study is not None:
                _study(config, summary)
            else:
                parts = assemble(config, partial(_timed, summary), names)
                summary.counted = parts.clip.known.counted
                if reason := no_evidence(config, names):
                    summary.left_out["log_evidence"] = reason
                with recorder_of(config, parts, summary) as recorder:
                    recorder.set_departures(parts.clip.known.departures)
                    record(parts, recorder, int(config.seed), summary, quiet)
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


def _study(config: DictConfig, summary: Summary) -> None:
    prior: Prior | None = None
    if config.prior is not None:
        with _timed(summary, "prior_learning"):
            prior = build(config.prior)
    study: Study = build(config.study, prior=prior)
    with RecordingFile(summary.recording, **_labels(config, summary)) as file:
        with _timed(summary, "study"):
            result = study.run(rng_streams(int(config.seed))["study"])
        summary.study = result.metrics
        record_study(file, result)
        file.send_property("cost", summary.cost)


def record(parts: Parts, recorder: Recorder, seed: int, summary: Summary, quiet: bool) -> None:
    """Track, record every step with its errors, and count it in the summary; quiet: no progress bar."""
    meter, disable = Meter(parts), True if quiet else None
    with logging_redirect_tqdm(), tqdm(total=len(parts.clip), unit="frame", disable=disable) as bar:
        for step, errors in track(parts, seed, meter):
            if not np.isfinite(step.log_evidence):
                summary.left_out.setdefault("log_evidence", "this inference does not estimate it")
            evidence = {} if "log_evidence" in summary.left_out else {"log_evidence": step.log_evidence}
            with _timed(summary, "recording"):
                recorder.log(step, {**evidence, **errors})
            summary.add(step, errors)
            for sentence in step.warnings:
                log.warning(sentence)
            shown = [form.format(errors[name]) for name, form in _SHOWN.items() if name in errors][:1]
            bar.set_postfix_str(", ".join([*shown, f"ESS {step.ess:.0f}"]))
            bar.update()
    summary.over_run = meter.over_run


def recorder_of(config: DictConfig, parts: Parts, summary: Summary) -> Recorder:
    """Build what records a run of these parts into `summary.recording`, not yet open; InputError as `Recorder`."""
    space = parts.inference.space
    n_coefficients = len(range(len(space))[space.slices.get("coefficients", slice(0))])
    scale = np.ones(n_coefficients)  # every prior counts them in standard deviations
    live = {"path": summary.recording, "body": parts.body, "space": space, "coefficient_scale": scale}
    recorder: Recorder = build(config.recorder, **live, **_labels(config, summary))
    return recorder


def _labels(config: DictConfig, summary: Summary) -> dict[str, Any]:
    """Return what a recording says about its run."""
    return {
        "run_id": f"{summary.experiment}-{summary.started}-{summary.seed}",
        "config_yaml": OmegaConf.to_yaml(config, resolve=True),
        "provenance": {
            "experiment": summary.experiment,
            "seed": summary.seed,
            "given": ", ".join(summary.given),
            "identity": summary.identity or "",
            **summary.provenance,
            **versions(),
        },
    }


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
