"""A sweep that another process runs, perhaps on another machine: watched by what it leaves in its folder."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import isfinite
from pathlib import Path
from time import sleep
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from tqdm import tqdm
from yaml import YAMLError

from workbench.catalog.entry import SUMMARY, Entry, entry_of_folder
from workbench.errors import InputError
from workbench.experiment.schema import prepare_hydra
from workbench.limits import MOST_CONFIG, check_file, check_yaml
from workbench.report.tables import printable
from workbench.sweep import starter
from workbench.sweep.job import ENDED
from workbench.sweep.plan import ERRORS

PERIOD_S = 0.5
_GONE_AFTER = 20
"""Looks at jobs that nobody starts any more, or at a killed one, which whoever started it would have told by then."""
_PLAN = "multirun.yaml"


@dataclass(frozen=True)
class Watched:
    """A sweep in `folder`: the numbers of its jobs and the keys that vary in them."""

    folder: Path
    jobs: tuple[int, ...]
    keys: frozenset[str]

    def entries(self) -> dict[int, Entry]:
        """What has begun, by number; not what an earlier attempt left and this one is to run again."""
        found: dict[int, Entry] = {}
        for job in self.jobs:
            try:
                written = (self.folder / str(job) / SUMMARY).stat().st_mtime_ns
                entry = entry_of_folder(self.folder / str(job))
            except OSError:
                continue
            if entry.status == "complete" or written >= self._began_ns():
                found[job] = entry
        return found

    def of(self, job: int) -> str:
        """Tell what varies, as this job has it."""
        try:
            overrides = map(str, OmegaConf.load(self.folder / str(job) / ".hydra" / "overrides.yaml"))
        except (OSError, YAMLError):
            return ""
        return printable(" ".join(each for each in overrides if each.partition("=")[0] in self.keys))

    def left(self, entries: Mapping[int, Entry]) -> bool:
        """Tell whether nobody starts jobs any more, or waits for one that still runs."""
        known = starter.state_of(self.folder)
        if known is None:
            return any(entry.status == "killed" for entry in entries.values())
        return known == "done" or (known == "gone" and all(entry.status != "running" for entry in entries.values()))

    def _began_ns(self) -> int:
        plan = self.folder / _PLAN
        return plan.stat().st_mtime_ns if plan.is_file() else 0


def watched(folder: Path) -> Watched:
    """Read which jobs a sweep has from what Hydra left in its folder; raises InputError where that cannot be told."""
    plans = (folder / _PLAN, *sorted(folder.glob("*/.hydra/hydra.yaml")))
    plan = next((path for path in plans if path.is_file()), None)
    if plan is None:
        raise InputError(f"{folder}: expected the folder of a sweep, with {_PLAN} or jobs in it, found neither")
    prepare_hydra()  # the parameters may be told by our resolvers, as those of experiment=strangers
    try:
        check_file(plan, MOST_CONFIG)
        check_yaml(plan, plan.read_text(encoding="utf-8"), most_values=MOST_CONFIG)  # all jobs
        config = OmegaConf.load(plan)
        trials = OmegaConf.select(config, "hydra.sweeper.n_trials")
        overrides = OverridesParser.create().parse_overrides(_told(config))
        varied = {each.get_key_element(): each for each in overrides if each.is_sweep_override()}
        if trials is None:
            values = [list(each.sweep_string_iterator()) for each in varied.values()]
            trials = len(list(product(*values)))
        chosen = OmegaConf.select(config, "sweep.jobs")
    except (OSError, YAMLError, OmegaConfBaseException, HydraException, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{plan}: expected what Hydra leaves of a sweep: {' '.join(str(error).split())}") from None
    return Watched(folder, tuple(range(trials) if chosen is None else chosen), frozenset(varied))


def _told(config: Any) -> list[str]:
    params = OmegaConf.select(config, "hydra.sweeper.params") or {}
    return [f"{key}={value}" for key, value in params.items()] + list(config.hydra.overrides.task)


def watch(sweep: Watched, period_s: float = PERIOD_S) -> int:
    """Print a line whenever a job begins or ends, below them a bar in a terminal, until all have ended.

    Returns 0 when all are complete, else 1: some failed, or whoever started the jobs is gone. Raises InputError when
    the folder is.
    """
    entries = sweep.entries()
    print(f"{len(sweep.jobs)} jobs in {sweep.folder}: {_count(sweep, entries)}", flush=True)
    left = 0
    with tqdm(total=len(sweep.jobs), unit="job", disable=None) as bar:
        while True:
            bar.update(sum(entry.status in ENDED for entry in entries.values()) - bar.n)
            left = left + 1 if sweep.left(entries) else 0
            all_ended = all(job in entries and entries[job].status in ENDED for job in sweep.jobs)
            if all_ended or left > _GONE_AFTER:
                break
            if not sweep.folder.is_dir():
                raise InputError(f"{sweep.folder}: was removed meanwhile")
            sleep(period_s)
            before, entries = entries, sweep.entries()
            for job, entry in entries.items():
                if job not in before or before[job].status != entry.status:
                    bar.write(_line(sweep, entries, job))
    print(_count(sweep, entries), flush=True)
    if not all_ended:
        print(f"whoever started the jobs is gone; sweep.resume={sweep.folder} goes on with them")
    return 0 if all_ended and all(entry.status == "complete" for entry in entries.values()) else 1


def _count(sweep: Watched, entries: Mapping[int, Entry]) -> str:
    told = [entry.status for entry in entries.values()] + ["not begun"] * (len(sweep.jobs) - len(entries))
    return ", ".join(f"{told.count(status)} {status}" for status in sorted(set(told)))


def _line(sweep: Watched, entries: Mapping[int, Entry], job: int) -> str:
    entry, left = entries[job], sum(each not in entries or entries[each].status not in ENDED for each in sweep.jobs)
    return f"{job:4d}  {printable(entry.status):<11}  {_error(entry):>12}  {left:5d} left   {sweep.of(job)}"


def _error(entry: Entry) -> str:
    found = next((entry.metrics[name] for name in ERRORS if name in entry.metrics), float("nan"))
    return f"{found:.4g}" if isfinite(found) and entry.status == "complete" else "-"
