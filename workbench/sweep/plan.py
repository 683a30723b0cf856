"""A sweep over configurations: which jobs it has, and whether it can be started."""

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
"""In a sweep's folder: its configuration, as Hydra leaves it."""

_SUBDIR = "${hydra.job.num}"
_COUNTS = (
    "hydra.sweeper.n_trials", "hydra.sweeper.n_jobs", "hydra.sweeper.max_batch_size", "hydra.launcher.n_jobs",
)  # fmt: skip
"""Numbers of jobs, trials and processes that sweepers and launchers may have."""


@dataclass(frozen=True)
class Plan:
    """A sweep before it runs.

    folder: of the sweep; job k works in `folder/k`. metric: the number to show and to minimise, None for the usual
    one. keys: what varies. jobs: the numbers of the jobs to run. tuned: whether a tuner chooses what they run.
    """

    folder: Path
    metric: str | None
    keys: tuple[str, ...]
    jobs: tuple[int, ...]
    tuned: bool = False

    def of(self, job: int) -> str:
        """Return what varies, as a job that has begun has it; nothing where that cannot be read."""
        try:
            overrides = map(str, OmegaConf.load(self.folder / str(job) / ".hydra" / "overrides.yaml"))
        except (OSError, YAMLError):
            return ""
        return " ".join(text for text in overrides if text.partition("=")[0] in self.keys)


def plan_of(config: DictConfig) -> Plan:
    """Return the plan of the sweep that Hydra is about to start with this configuration, `hydra` included.

    Raises InputError for a folder that holds a sweep already, unless it is to be resumed, for one to be resumed that
    is not there, where jobs would share a folder, for numbers that no sweep can have or whose jobs would all be
    refused, and for a tuner that would try something else the second time.
    """
    sweeper, folder, resume = config.hydra.sweeper, Path(config.hydra.sweep.dir), config.sweep.resume
    if f"subdir: {_SUBDIR}\n" not in OmegaConf.to_yaml(config.hydra.sweep):
        raise InputError(f"hydra.sweep.subdir must be {_SUBDIR}, so that no job overwrites another")
    if resume is None and any(each.name.isdecimal() for each in folder.glob("*")):
        raise InputError(f"{folder}: holds a sweep already; sweep.resume={folder} resumes it")
    for key in ("resume", "reuse"):
        if (place := config.sweep[key]) is not None and not Path(place).is_dir():
            raise InputError(f"sweep.{key}: expected the folder of an earlier sweep, found no {place}")
    if config.sweep.stop_if is not None:
        parse_stop_condition(config.sweep.stop_if)
    for name in _COUNTS:
        found = OmegaConf.select(config, name)
        every = found == -1 and name == "hydra.launcher.n_jobs"  # all processors
        if isinstance(found, int) and not (1 <= found <= MAX_JOBS or every):
            raise InputError(f"{name}: expected a number of 1 to {MAX_JOBS}, found {found}")
    if not sweeper._target_.endswith(".BasicSweeper"):
        if "n_trials" not in sweeper:
            raise InputError(f"hydra/sweeper must be basic or optuna, found {sweeper._target_}")
        if resume is not None and (sweeper.get("sampler") or {}).get("seed") is None:
            raise InputError("sweep.resume: a tuner repeats its trials only if hydra.sweeper.sampler.seed is set")
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
    return Plan(folder, OmegaConf.select(config, "sweep.objective"), tuple(swept), jobs, tuned=n_trials is not None)


def _swept(sweeper: DictConfig, task: list[str]) -> dict[str, list[str]]:
    """Return the keys that vary and, where they are a list and not an interval, their values, in the sweep's order."""
    loader = GlobalHydra.instance().config_loader() if GlobalHydra.instance().is_initialized() else None
    given = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()] + task
    chosen = {each.get_key_element(): each for each in OverridesParser.create(loader).parse_overrides(given)}
    swept = {key: each for key, each in chosen.items() if each.is_sweep_override()}
    return {
        key: list(islice(each.sweep_string_iterator(), MAX_JOBS + 1)) if each.is_discrete_sweep() else []
        for key, each in swept.items()
    }


def read_plan(folder: Path) -> Plan:
    """Read which jobs a sweep has from what Hydra left in its folder; raises InputError where that cannot be read."""
    places = (folder / PLAN, *sorted(folder.glob("*/.hydra/hydra.yaml")))
    place = next((path for path in places if path.is_file()), None)
    if place is None:
        raise InputError(f"{folder}: expected the folder of a sweep, with {PLAN} or jobs in it, found neither")
    prepare_hydra()  # parameters may use our resolvers, as those of experiment=held_out_subjects do
    try:
        check_file(place, MAX_CONFIG)
        return _jobs_of(OmegaConf.load(place), folder)
    except (OSError, YAMLError, OmegaConfBaseException, HydraException, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{place}: expected what Hydra leaves of a sweep: {' '.join(str(error).split())}") from None
