"""Follow a sweep that another process runs, by what it leaves in its folder."""

from pathlib import Path
from time import sleep

from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from workbench.experiment.config.schema import prepare_hydra
from workbench.sweep.plan import Plan, jobs_of
from workbench.sweep.progress import PERIOD_S, Progress
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MOST_CONFIG, check_file
from workbench.utils.run_lock import is_locked

_PLAN = "multirun.yaml"


def read_plan(folder: Path) -> Plan:
    """Read which jobs a sweep has from what Hydra left in its folder; raises InputError where that cannot be read."""
    places = (folder / _PLAN, *sorted(folder.glob("*/.hydra/hydra.yaml")))
    place = next((path for path in places if path.is_file()), None)
    if place is None:
        raise InputError(f"{folder}: expected the folder of a sweep, with {_PLAN} or jobs in it, found neither")
    prepare_hydra()  # parameters may use our resolvers, as those of experiment=strangers do
    try:
        check_file(place, MOST_CONFIG)
        return jobs_of(OmegaConf.load(place), folder)
    except (OSError, YAMLError, OmegaConfBaseException, HydraException, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{place}: expected what Hydra leaves of a sweep: {' '.join(str(error).split())}") from None


def watch(folder: Path, period_s: float = PERIOD_S) -> int:
    """Print the table of a sweep until all jobs have ended, or no process is at work in the sweep.

    Returns 0 when all jobs are complete, else 1. Raises InputError where there is no sweep, or it is removed.
    """
    plan, start = read_plan(folder), folder / _PLAN
    progress = Progress(plan, began_ns=start.stat().st_mtime_ns if start.is_file() else 0)
    alive = True
    while alive and progress.not_ended():
        sleep(period_s)
        if not folder.is_dir():
            raise InputError(f"{folder}: was removed")
        alive = is_locked(folder) or any(is_locked(folder / str(job)) for job in progress.not_ended())
    progress.stop()
    missing = progress.not_complete()
    for job, reason in missing.items():
        print(f"{folder / str(job)}: {reason}")
    if progress.not_ended():
        print(f"no process is at work in the sweep; sweep.resume={folder} resumes it")
    return 1 if missing else 0
