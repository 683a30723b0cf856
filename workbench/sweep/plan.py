"""Plan of a sweep over configurations: its jobs, and whether it can be started."""

import math
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from workbench.experiment.config.schema import prepare_hydra
from workbench.sweep.early_stop import parse_stop_condition
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_CONFIG, MAX_JOBS, check_file, check_number

PLAN = "multirun.yaml"
"""File in a sweep's folder with its configuration, written by Hydra."""

_SUBDIR = "${hydra.job.num}"
_COUNTS = (
    "hydra.sweeper.n_trials", "hydra.sweeper.n_jobs", "hydra.sweeper.max_batch_size", "hydra.launcher.n_jobs",
)  # fmt: skip
"""Keys with numbers of jobs, trials and processes."""


@dataclass(frozen=True)
class Plan:
    """Plan of a sweep.

    folder: of the sweep; job k runs in `folder/k`. objective: metric to show and minimise, None: the default. keys:
    the varied keys. jobs: numbers of the jobs to run.
    """

    folder: Path
    objective: str | None
    keys: tuple[str, ...]
    jobs: tuple[int, ...]

    def overrides_of(self, job: int) -> str:
        """Return the varied overrides of a job that has begun; empty if they cannot be read."""
        try:
            overrides = map(str, OmegaConf.load(self.folder / str(job) / ".hydra" / "overrides.yaml"))
        except (OSError, YAMLError):
            return ""
        return " ".join(text for text in overrides if text.partition("=")[0] in self.keys)


def plan_of(config: DictConfig) -> Plan:
    """Return the plan of the sweep that Hydra is about to start with this configuration, `hydra` included.

    Raises
    ------
    InputError : the folder contains another sweep, a sweep to resume does not exist, jobs would share a folder,
        numbers of jobs or the stop condition are invalid, or a tuner to resume has no fixed seed.
    """
    sweeper, folder, resume = config.hydra.sweeper, Path(config.hydra.sweep.dir), config.sweep.resume
    if f"subdir: {_SUBDIR}\n" not in OmegaConf.to_yaml(config.hydra.sweep):
        raise InputError(f"hydra.sweep.subdir: expected {_SUBDIR}, so that jobs do not overwrite each other")
    if resume is None and any(path.name.isdecimal() for path in folder.glob("*")):
        raise InputError(f"{folder}: contains a sweep; sweep.resume={folder} resumes it")
    for key in ("resume", "reuse"):
        if (place := config.sweep[key]) is not None and not Path(place).is_dir():
            raise InputError(f"sweep.{key}: expected the folder of an earlier sweep, found no {place}")
    if config.sweep.stop_if is not None:
        parse_stop_condition(config.sweep.stop_if)
    for name in _COUNTS:
        number = OmegaConf.select(config, name)
        all_cores = number == -1 and name == "hydra.launcher.n_jobs"
        if isinstance(number, int) and not (1 <= number <= MAX_JOBS or all_cores):
            raise InputError(f"{name}: expected a number of 1 to {MAX_JOBS}, found {number}")
    if not sweeper._target_.endswith(".BasicSweeper"):
        if "n_trials" not in sweeper:
            raise InputError(f"hydra/sweeper: expected basic or optuna, found {sweeper._target_}")
        if resume is not None and (sweeper.get("sampler") or {}).get("seed") is None:
            raise InputError("sweep.resume: a tuner repeats its trials only with hydra.sweeper.sampler.seed; set it")
    return _jobs_of(config, folder)


def _jobs_of(config: Any, folder: Path) -> Plan:
    """Return the plan of a sweep in `folder` by its configuration, or what Hydra saved of it.

    Raises InputError for more jobs than MOST_JOBS and for unknown numbers in sweep.job_ids.
    """
    sweeper, chosen = config.hydra.sweeper, OmegaConf.select(config, "sweep.job_ids")
    swept = _swept(sweeper, list(config.hydra.overrides.task))
    n_trials = sweeper.get("n_trials")
    n_jobs: int = math.prod(map(len, swept.values())) if n_trials is None else n_trials
    check_number("sweep" if n_trials is None else "hydra.sweeper.n_trials", "jobs", n_jobs, MAX_JOBS)
    jobs = tuple(range(n_jobs) if chosen is None else chosen)
    if unknown := [job for job in jobs if not 0 <= job < n_jobs]:
        raise InputError(f"sweep.job_ids: expected numbers below {n_jobs}, found {unknown[0]}")
    return Plan(folder, OmegaConf.select(config, "sweep.objective"), tuple(swept), jobs)


def _swept(sweeper: DictConfig, task: list[str]) -> dict[str, list[str]]:
    """Return the values of each varied key in the sweep's order; an empty list for an interval."""
    loader = GlobalHydra.instance().config_loader() if GlobalHydra.instance().is_initialized() else None
    words = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()] + task
    parsed = OverridesParser.create(loader).parse_overrides(words)
    overrides = {override.get_key_element(): override for override in parsed}
    swept = {key: override for key, override in overrides.items() if override.is_sweep_override()}
    return {
        key: list(islice(override.sweep_string_iterator(), MAX_JOBS + 1)) if override.is_discrete_sweep() else []
        for key, override in swept.items()
    }


def read_plan(folder: Path) -> Plan:
    """Return the plan of a sweep from the files that Hydra wrote in its folder; InputError if they cannot be read."""
    files = (folder / PLAN, *sorted(folder.glob("*/.hydra/hydra.yaml")))
    file = next((path for path in files if path.is_file()), None)
    if file is None:
        raise InputError(f"{folder}: expected the folder of a sweep, with {PLAN} or jobs in it, found neither")
    prepare_hydra()  # for resolvers in the parameters
    try:
        check_file(file, MAX_CONFIG)
        return _jobs_of(OmegaConf.load(file), folder)
    except (OSError, YAMLError, OmegaConfBaseException, HydraException, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{file}: expected the configuration of a sweep: {' '.join(str(error).split())}") from None
