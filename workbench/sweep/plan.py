"""A sweep over configurations: which jobs it has, and what is done for one of them."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, Override, RangeSweep
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.errors import InputError
from workbench.evaluation import headline
from workbench.experiment.identity import identity
from workbench.limits import MOST_JOBS, MOST_PROCESSES, MOST_ROUNDS, check_number, check_sizes
from workbench.sweep.job import KILLED, alone, put_back, read_summary, run_apart, write_failure
from workbench.sweep.process import STOP_WHEN
from workbench.sweep.reuse import RECORDING, set_aside, take_over
from workbench.sweep.stopping import stop_when

SUBDIR = "${hydra.job.num}"
FAILED = ".failed"
"""In a sweep's folder: the number of a job that has failed since the sweep began."""
ENDING = ".ending"
"""In a sweep's folder: a sign that whoever started the jobs was asked to end, and that no more are to begin."""
ERRORS = tuple(headline.ERRORS)
"""What a sweep minimises where its configuration names no metric: the first of these that a run has."""
_BOUNDS: Mapping[str, tuple[int, int]] = {
    "sweep.retries": (0, MOST_ROUNDS),
    "hydra.sweeper.n_trials": (1, MOST_JOBS),
    "hydra.sweeper.n_jobs": (1, MOST_PROCESSES),
    "hydra.sweeper.max_failure_rate": (0, 1),
    "hydra.sweeper.max_batch_size": (1, MOST_JOBS),
    "hydra.sweeper.sampler.seed": (0, 2**32 - 1),
    "hydra.launcher.n_jobs": (-1, MOST_PROCESSES),
}
"""The least and the most of what a sweep is told in numbers; sweepers and launchers have them or not."""


@dataclass(frozen=True)
class Plan:
    """A sweep before it runs.

    folder: of the sweep; job k works in `folder/k`. metric: the number to show and to minimise, None for the usual
    one. keys: what varies. varied: for every job its overrides of these keys, None where a tuner chooses them as it
    goes. jobs: the numbers of the jobs to run.
    """

    folder: Path
    metric: str | None
    keys: tuple[str, ...]
    varied: tuple[tuple[str, ...], ...] | None
    jobs: tuple[int, ...]

    def of(self, job: int) -> str:
        """Tell what varies, as job number `job` has it."""
        if self.varied is not None:
            return " ".join(self.varied[job])
        overrides = map(str, OmegaConf.load(self.folder / str(job) / ".hydra" / "overrides.yaml"))
        return " ".join(text for text in overrides if text.partition("=")[0] in self.keys)


def plan_of(config: DictConfig) -> Plan:
    """The sweep that Hydra is about to start with this configuration, `hydra` included.

    Raises InputError for a folder that holds a sweep already, unless it is to be resumed, for one to be resumed that
    is not there, where jobs would share a folder, for more of them than MOST_JOBS, for numbers that no sweep can have
    or whose jobs would all be refused, and for a tuner that would try something else the second time.
    """
    sweeper, folder, resume = config.hydra.sweeper, Path(config.hydra.sweep.dir), config.sweep.resume
    if f"subdir: {SUBDIR}\n" not in OmegaConf.to_yaml(config.hydra.sweep):
        raise InputError(f"hydra.sweep.subdir must be {SUBDIR}, so that no job writes over another")
    if resume is None and any(each.name.isdecimal() for each in folder.glob("*")):
        raise InputError(f"{folder}: holds a sweep already; sweep.resume={folder} goes on with it")
    for key in ("resume", "reuse"):
        if (place := config.sweep[key]) is not None and not Path(place).is_dir():
            raise InputError(f"sweep.{key}: expected the folder of an earlier sweep, found no {place}")
    if config.sweep.stop_when is not None:
        stop_when(config.sweep.stop_when)
    if config.sweep.halving is not None:
        raise InputError("sweep.halving: expected on the command line, found in a file")
    _check_numbers(config)
    swept = _swept(sweeper, list(config.hydra.overrides.task))
    varied, place = None, "sweep" if "n_trials" not in sweeper else "hydra.sweeper.n_trials"
    check_number(place, "jobs", sweeper.get("n_trials") or math.prod(map(len, swept.values())), MOST_JOBS)
    if sweeper._target_.endswith(".BasicSweeper"):
        varied = tuple(product(*([f"{key}={value}" for value in values] for key, values in swept.items())))
    elif resume is not None and (sweeper.get("sampler") or {}).get("seed") is None:
        raise InputError("sweep.resume: a tuner repeats its trials only if hydra.sweeper.sampler.seed is set")
    elif "n_trials" not in sweeper:
        raise InputError(f"hydra/sweeper must be basic or optuna, found {sweeper._target_}")
    n_jobs = sweeper.n_trials if varied is None else len(varied)
    jobs = tuple(range(n_jobs) if config.sweep.jobs is None else config.sweep.jobs)
    if unknown := [job for job in jobs if not 0 <= job < n_jobs]:
        raise InputError(f"sweep.jobs: expected numbers below {n_jobs}, found {unknown[0]}")
    return Plan(folder, config.sweep.metric, tuple(swept), varied, jobs)


def config_of(config: DictConfig, plan: Plan, job: int, *overrides: str) -> DictConfig:
    """Compose a job of the sweep that Hydra is about to start with `config`, as a launcher does; overrides: more."""
    chosen = _chosen(config.hydra.sweeper, list(config.hydra.overrides.task))
    same = [str(each.input_line) for each in chosen.values() if not each.is_sweep_override()]
    varied = () if plan.varied is None else plan.varied[job]
    return GlobalHydra.instance().config_loader().load_sweep_config(config, [*same, *varied, *overrides])


def run_job(config: DictConfig, sweep: DictConfig, experiment: str, settings: Any) -> float | None:
    """Run one job, unless it is complete and to be kept; returns the metric of its run, for a tuner to minimise.

    sweep: the configuration's keys of that name, which `config` is without. settings: Hydra's for this job. The job
    works in a process of its own and whatever becomes of it is in its summary.json; one that did not complete, was
    stopped, or came to no finite number, returns the worst there is. One that was killed is tried again
    sweep.retries times; with sweep.fail_fast none begins after one has failed. Raises InputError when the run has no
    number called sweep.metric.
    """
    folder = Path(settings.runtime.output_dir)
    if sweep.jobs is None or settings.job.num in sweep.jobs:
        with alone(folder) as lock:
            if not _kept(config, sweep, folder):
                _attempt(config, sweep, experiment, folder, folder / f"{settings.job.name}.log", lock)
    summary = read_summary(folder) or {}
    complete = summary.get("status") == "complete"
    metric = metric_of(summary["metrics"], sweep.metric) if complete else None
    if metric is None and (sweep.metric is not None or not complete):
        return worst(settings.sweeper)
    return metric


def worst(sweeper: DictConfig) -> float:
    """The worst number for a tuner, of a job that came to none."""
    return -math.inf if "maximize" in str(sweeper.get("direction")) else math.inf


def _attempt(config: DictConfig, sweep: DictConfig, experiment: str, folder: Path, output: Path, lock: int) -> None:
    """Run a job, as often as sweep.retries allows where it is killed, or not at all where sweep.fail_fast says so."""
    failed, nothing = folder.parent / FAILED, {"experiment": experiment, "metrics": {}}
    if sweep.fail_fast and failed.is_file():
        write_failure(folder, f"not begun, as job {failed.read_text()} failed and sweep.fail_fast is true", nothing)
        return
    summary: dict[str, Any] = {}
    for _ in range(1 + sweep.retries):
        put_back(folder, sweep.stop_when)  # without sweep.resume, too: Slurm may run a job of a sweep twice
        if (folder.parent / ENDING).is_file():
            return
        try:
            run_apart(config, experiment, folder, output, lock, sweep.stop_when)
        except OmegaConfBaseException as error:  # a configuration that cannot be resolved
            write_failure(folder, f"{type(error).__name__}: {error}", nothing)
        summary = read_summary(folder) or {}
        if not str(summary.get("error")).startswith(KILLED):
            break
    if summary.get("status") == "failed":
        failed.write_text(folder.name)


def metric_of(metrics: Mapping[str, float | None], name: str | None) -> float | None:
    """The run's number called `name`, of None the usual error; raises InputError when there is no such number."""
    if name is None:
        return next((metrics[error] for error in ERRORS if error in metrics), None)
    if name not in metrics:
        raise InputError(f"sweep.metric: expected one of {', '.join(sorted(metrics))}, found {name!r}")
    return metrics[name]


def _kept(config: DictConfig, sweep: DictConfig, folder: Path) -> bool:
    """Whether a complete run that would come out the same is there, in this job's folder or taken over from another.

    Looked for where sweep.resume and sweep.reuse say. Its summary is then marked as looked at.
    """
    places = [Path(place) for place in (sweep.resume, sweep.reuse) if place is not None]
    if not places:
        return False
    try:
        wanted = identity(config)
    except (InputError, OmegaConfBaseException):  # the run itself will say so
        return False
    summary = read_summary(folder) or {}
    ended = summary.get("status") == "complete" or (summary.get("status") == "stopped" and _stopped_so(folder, sweep))
    if ended and (folder / RECORDING).is_file() and summary.get("identity") == wanted:
        os.utime(folder / "summary.json")
        return True
    set_aside(folder)
    return take_over(wanted, folder, places)


def _stopped_so(folder: Path, sweep: DictConfig) -> bool:
    """Whether the run in a folder was stopped by the condition that would stop it now."""
    written = folder / STOP_WHEN
    return written.is_file() and written.read_text() == (sweep.stop_when or "")


def _check_numbers(config: DictConfig) -> None:
    """Refuse numbers for a sweeper or a launcher on which it would end or never come back."""
    for name, (least, most) in _BOUNDS.items():
        found = OmegaConf.select(config, name)
        if isinstance(found, int | float) and not least <= found <= most:
            raise InputError(f"{name}: expected a number of {least} to {most}, found {found}")
    if OmegaConf.select(config, "hydra.launcher.n_jobs") == 0:
        raise InputError("hydra.launcher.n_jobs: expected -1, which is all processors, or 1 and more, found 0")
    for part in ("sweeper", "launcher"):
        check_sizes(OmegaConf.to_container(config.hydra[part]), f"hydra.{part}")


def _swept(sweeper: DictConfig, task: list[str]) -> dict[str, list[str]]:
    """The keys that vary and, where they are a list and not an interval, their values, in the order of the sweep."""
    return {key: _values(each) for key, each in _chosen(sweeper, task).items() if each.is_sweep_override()}


def _chosen(sweeper: DictConfig, task: list[str]) -> dict[str, Override]:
    """What the sweeper's own keys and the command line say, the latter in place of the former."""
    loader = GlobalHydra.instance().config_loader()
    given = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()] + task
    return {each.get_key_element(): each for each in OverridesParser.create(loader).parse_overrides(given)}


def _values(swept: Override) -> list[str]:
    """List what a key goes through, nothing for an interval; InputError, before that, for a range of more than any
    sweep has jobs, and for numbers that no run can have."""
    key, numbers, found = swept.get_key_element().lstrip("+"), [], swept.value()
    if isinstance(found, RangeSweep):
        numbers = list(islice(iter(found.range()), MOST_JOBS + 1))
        check_number(f"sweep: {key}", "values", len(numbers), MOST_JOBS)
    elif isinstance(found, ChoiceSweep):
        numbers = found.list
    elif isinstance(found, IntervalSweep):
        numbers = [found.start, found.end]
    check_sizes(numbers, key)
    return list(swept.sweep_string_iterator()) if swept.is_discrete_sweep() else []
