"""Table of a sweep: a line for every job that ends, then a list of the jobs that are not complete."""

import multiprocessing
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any, ClassVar

from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from workbench.sweep.job import ASIDE, FAILED, metric_of
from workbench.sweep.orphans import Guard
from workbench.sweep.plan import PLAN, Plan, plan_of, read_plan
from workbench.utils.errors import InputError
from workbench.utils.run_files import SUMMARY, read_summary
from workbench.utils.run_lock import is_locked, run_folder
from workbench.utils.text import printable

_ENDED = ("complete", "stopped", "failed", "interrupted")
"""Statuses in summary.json of a run that has ended."""

PERIOD_S = 0.5
_LONGEST_END_S = 20.0
"""Time for jobs to end after a signal, before their launcher kills them."""

_JOBLIB = "JoblibLauncher"


class Progress:
    """Progress of the jobs of a sweep, read from their folders and so independent of the launcher.

    Job k has ended if `k/summary.json` was written after the start of the sweep and has a status in _ENDED. launcher:
    class name of the launcher. began_ns: start of the sweep; None: now. Jobs are printed as they end, until `stop`.
    """

    def __init__(self, plan: Plan, launcher: str = "", began_ns: int | None = None) -> None:
        self.plan, self.launcher, self.ended = plan, launcher, dict[int, str]()
        self._written_ns = {job: self._written(job) for job in plan.jobs}
        if began_ns is not None:
            self._written_ns = {job: written if written < began_ns else 0 for job, written in self._written_ns.items()}
        self._started = {job: self._summary(job).get("started") for job, written in self._written_ns.items() if written}
        self._over = Event()
        print(f"{len(plan.jobs)} jobs in {plan.folder}")
        print(f" job  status       {plan.objective or 'error':>14}  seconds   left   verdict", flush=True)
        self._thread = Thread(target=self._watch, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Print the jobs that have ended and stop following."""
        self._over.set()
        self._thread.join()

    def not_ended(self) -> list[int]:
        """Return the jobs that are running, were killed or have not begun."""
        return [job for job in self.plan.jobs if job not in self.ended]

    def not_complete(self) -> dict[int, str]:
        """Return the reason for every job that is not complete."""
        successful = ("complete", "reused", "stopped")
        return {job: self._reason(job) for job in self.plan.jobs if self.ended.get(job) not in successful}

    def _watch(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            for job in self.plan.jobs:
                if (written := self._written(job)) != self._written_ns[job]:
                    self._update(job, written)

    def _update(self, job: int, written: int) -> None:
        summary = self._summary(job)
        self.ended.pop(job, None)  # Slurm may restart an interrupted job
        if (status := summary.get("status")) in _ENDED:
            same = "taken_from" in summary or summary.get("started") == self._started.get(job, "")
            self._written_ns[job], self.ended[job] = written, "reused" if same else str(status)
            print(printable(self._line(job, summary)), flush=True)

    def _line(self, job: int, summary: Mapping[str, Any]) -> str:
        metric, kind = None, "-"
        if summary["status"] == "complete":
            kind = str((summary.get("verdict") or {}).get("level", "-"))
            with suppress(InputError):
                metric = metric_of(summary.get("metrics", {}), self.plan.objective)
        value = "-" if metric is None else f"{metric:.4g}"
        line = f"{job:4d}  {self.ended[job]:<11}  {value:>14}  {summary.get('wall_s', 0.0):7.1f}"
        return f"{line}  {len(self.not_ended()):5d}   {kind:<16}   {self.plan.overrides_of(job)}"

    def _summary(self, job: int) -> dict[str, Any]:
        return read_summary(self.plan.folder / str(job)) or {}

    def _written(self, job: int) -> int:
        """Return the modification time of a job's summary, ns; 0 without one."""
        try:
            return (self.plan.folder / str(job) / SUMMARY).stat().st_mtime_ns
        except OSError:
            return 0

    def _reason(self, job: int) -> str:
        if job not in self.ended:
            state = "still running" if is_locked(self.plan.folder / str(job)) else "killed"
            return state if self._written(job) != self._written_ns[job] else "never begun"
        summary = self._summary(job)
        error = str(summary.get("error") or "")
        failed = summary.get("status") == "failed"
        return error if failed else f"interrupted by {error.partition(': ')[2] or 'a signal'}"


class Watch(Callback):
    """Starts the table when Hydra starts a sweep. Hydra creates the objects and sends them to its workers."""

    progress: ClassVar[Progress | None] = None
    """Progress of the sweep of this process."""
    lock: ClassVar[ExitStack] = ExitStack()
    """Lock of the sweep's folder, held while jobs may begin."""
    guard: ClassVar[Guard | None] = None
    """Ends joblib's workers if this process is killed."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        """Exit if another process uses the folder, before Hydra writes the configuration into it."""
        try:
            with run_folder(Path(config.hydra.run.dir)):
                pass
        except (InputError, OmegaConfBaseException) as error:
            _exit(error)

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Check the sweep and start its table; exit with code 2 if it cannot be started."""
        try:
            plan = plan_of(config)
            Watch.lock.enter_context(run_folder(plan.folder))
        except (InputError, HydraException, OmegaConfBaseException) as error:
            _exit(error)
        (plan.folder / FAILED).unlink(missing_ok=True)
        Watch.progress = Progress(plan, launcher := str(config.hydra.launcher._target_))
        if launcher.endswith(_JOBLIB):
            Watch.guard = Guard(os.getpid())

    @classmethod
    def end(cls) -> None:
        """Prevent further jobs and interrupt those of joblib's workers, which joblib would kill."""
        cls.lock.close()
        if cls.progress is None or not cls.progress.launcher.endswith(_JOBLIB):
            return
        folders = [cls.progress.plan.folder / str(job) for job in cls.progress.not_ended()]
        for worker in multiprocessing.active_children():
            worker.terminate()
        latest = monotonic() + _LONGEST_END_S
        while any(map(is_locked, folders)) and monotonic() < latest:
            sleep(0.1)


def _exit(error: Exception) -> None:
    print(f"workbench: {error}", file=sys.stderr)
    sys.exit(2)  # Hydra turns any other exception into a warning


def close(progress: Progress, arguments: Sequence[str]) -> int:
    """Print every job that is not complete and how to repeat it; return the sweep's exit code, 0 or 1."""
    progress.stop()
    Watch.lock.close()
    if Watch.guard is not None:
        Watch.guard.release()
    folder = progress.plan.folder
    if left := len(list((folder / ASIDE).glob(f"*/{SUMMARY}"))):
        print(f"{left} complete runs of other configurations were moved to {folder / ASIDE}")
    if not (missing := progress.not_complete()):
        return 0
    print(f"workbench: {len(missing)} of {len(progress.plan.jobs)} jobs are not complete:", file=sys.stderr)
    for job, reason in missing.items():
        print(f"  {folder / str(job)}: {' '.join(reason.split())}", file=sys.stderr)
    words = [word for word in arguments if not word.startswith(("sweep.resume=", "hydra.sweep.dir="))]
    print(f"repeat them: {shlex.join(['workbench', 'run', *words, f'sweep.resume={folder}'])}", file=sys.stderr)
    return 1


def watch(folder: Path) -> int:
    """Print the table of a sweep until all jobs have ended or no process runs the sweep.

    Returns 0 if all jobs are complete, else 1. Raises InputError if there is no sweep or its folder is removed.
    """
    plan, start = read_plan(folder), folder / PLAN
    progress = Progress(plan, began_ns=start.stat().st_mtime_ns if start.is_file() else 0)
    alive = True
    try:
        while alive and progress.not_ended():
            sleep(PERIOD_S)
            if not folder.is_dir():
                raise InputError(f"{folder}: the folder was removed")
            alive = is_locked(folder) or any(is_locked(folder / str(job)) for job in progress.not_ended())
    finally:
        progress.stop()
    missing = progress.not_complete()
    for job, reason in missing.items():
        print(f"{folder / str(job)}: {reason}")
    if progress.not_ended():
        print(f"no process runs the sweep; sweep.resume={folder} resumes it")
    return 1 if missing else 0
