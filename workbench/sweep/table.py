"""The table of a sweep: a line for every job that ends and, at the end, every job that is not complete."""

import multiprocessing
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

from workbench.results.formatting import printable
from workbench.sweep.job import ASIDE, FAILED, metric_of
from workbench.sweep.plan import PLAN, Plan, plan_of, read_plan
from workbench.utils.errors import InputError
from workbench.utils.run_files import SUMMARY, read_summary
from workbench.utils.run_lock import is_locked, run_folder

_ENDED = ("complete", "stopped", "failed", "interrupted")
"""Statuses in summary.json of a run that has ended by itself."""

PERIOD_S = 0.5
_LONGEST_END_S = 20.0
"""Time that jobs have to end in after a signal, before their launcher kills them."""

_JOBLIB = "JoblibLauncher"


class Progress:
    """The jobs of a sweep as their folders show, which are alike for all launchers.

    Job k has ended when `k/summary.json` was written since the sweep began, and its status is in _ENDED. launcher: name
    of its class. began_ns: when the sweep began; None: now.
    """

    def __init__(self, plan: Plan, launcher: str = "", began_ns: int | None = None) -> None:
        self.plan, self.launcher, self.ended = plan, launcher, dict[int, str]()
        self._seen = {job: self._written(job) for job in plan.jobs}
        if began_ns is not None:
            self._seen = {job: written if written < began_ns else 0 for job, written in self._seen.items()}
        self._started = {job: self._summary(job).get("started") for job, written in self._seen.items() if written}
        self._over = Event()
        print(f"{len(plan.jobs)} jobs in {plan.folder}")
        print(f" job  status       {plan.metric or 'error':>14}  seconds   left   verdict", flush=True)
        self.follow()

    def follow(self) -> None:
        """Print jobs that end until `stop` is called."""
        self._over.clear()
        self._thread = Thread(target=self._watch, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Print what has ended by now, and no more."""
        self._over.set()
        self._thread.join()

    def not_ended(self) -> list[int]:
        """Return the jobs that run, were killed or have not begun."""
        return [job for job in self.plan.jobs if job not in self.ended]

    def not_begun(self) -> list[int]:
        """Return the jobs that have left nothing since the sweep began."""
        return [job for job in self.not_ended() if self._written(job) == self._seen[job]]

    def not_complete(self) -> dict[int, str]:
        """Return the reason for every job that is not complete."""
        fine = ("complete", "kept", "stopped")
        return {job: self._reason(job) for job in self.plan.jobs if self.ended.get(job) not in fine}

    def _watch(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            for job in self.plan.jobs:
                if (written := self._written(job)) != self._seen[job]:
                    self._look(job, written)

    def _look(self, job: int, written: int) -> None:
        summary = self._summary(job)
        self.ended.pop(job, None)  # one that was interrupted may begin again, as Slurm has jobs do
        if (status := summary.get("status")) in _ENDED:
            same = "taken_from" in summary or summary.get("started") == self._started.get(job, "")
            self._seen[job], self.ended[job] = written, "kept" if same else str(status)
            print(printable(self._line(job, summary) + ("" if same else _how(summary))), flush=True)

    def _line(self, job: int, summary: Mapping[str, Any]) -> str:
        metric, kind = None, "-"
        if summary["status"] == "complete":
            kind = str((summary.get("verdict") or {}).get("kind", "-"))
            with suppress(InputError):
                metric = metric_of(summary.get("metrics", {}), self.plan.metric)
        shown = "-" if metric is None else f"{metric:.4g}"
        line = f"{job:4d}  {self.ended[job]:<11}  {shown:>14}  {summary.get('wall_s', 0.0):7.1f}"
        return f"{line}  {len(self.not_ended()):5d}   {kind:<16}   {self.plan.of(job)}"

    def _summary(self, job: int) -> dict[str, Any]:
        return read_summary(self.plan.folder / str(job)) or {}

    def _written(self, job: int) -> int:
        """Return the time of a job's summary in ns, 0 where there is none."""
        try:
            return (self.plan.folder / str(job) / SUMMARY).stat().st_mtime_ns
        except OSError:
            return 0

    def _reason(self, job: int) -> str:
        if job not in self.ended:
            begun = "still running" if is_locked(self.plan.folder / str(job)) else "killed"
            return begun if self._written(job) != self._seen[job] else "never begun"
        summary = self._summary(job)
        error = str(summary.get("error") or "")
        failed = summary.get("status") == "failed"
        return error if failed else f"interrupted by {error.partition(': ')[2] or 'a signal'}"


def _how(summary: Mapping[str, Any]) -> str:
    """Return whether a job resumed an earlier attempt, or why it did not."""
    if continued := (summary.get("provenance") or {}).get("continued"):
        return f"  (resumed at frame {str(continued).rpartition('@')[2]})"
    return f"  (from scratch: {summary['restart_reason']})" if summary.get("restart_reason") else ""


class Watch(Callback):
    """Starts the table when Hydra starts a sweep. Hydra makes these objects itself and sends them to its workers."""

    progress: ClassVar[Progress | None] = None
    """Of the sweep that this process runs."""
    lock: ClassVar[ExitStack] = ExitStack()
    """Holds the sweep's folder while jobs may begin."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        """Refuse a folder that another process works in, before Hydra writes the configuration into it."""
        try:
            with run_folder(Path(config.hydra.run.dir)):
                pass
        except (InputError, OmegaConfBaseException) as error:
            _refuse(error)

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Check the sweep and start its table; ends the command with code 2 when the sweep cannot be started."""
        try:
            plan = plan_of(config)
            if Watch.progress is None:  # else the launcher is started again
                Watch.lock.enter_context(run_folder(plan.folder))
        except (InputError, HydraException, OmegaConfBaseException) as error:
            _refuse(error)
        if Watch.progress is not None:
            Watch.progress.follow()
            return
        (plan.folder / FAILED).unlink(missing_ok=True)
        Watch.progress = Progress(plan, str(config.hydra.launcher._target_))

    @classmethod
    def end(cls) -> None:
        """Let no more jobs begin, and interrupt those of joblib's workers, which joblib would kill."""
        cls.lock.close()
        if cls.progress is None or not cls.progress.launcher.endswith(_JOBLIB):
            return
        folders = [cls.progress.plan.folder / str(job) for job in cls.progress.not_ended()]
        for worker in multiprocessing.active_children():
            worker.terminate()
        latest = monotonic() + _LONGEST_END_S
        while any(map(is_locked, folders)) and monotonic() < latest:
            sleep(0.1)


def _refuse(error: Exception) -> None:
    print(f"workbench: {error}", file=sys.stderr)
    sys.exit(2)  # Hydra makes a warning of any other exception


def rest_of(progress: Progress) -> list[str]:
    """Return the overrides that run the jobs which have not begun when joblib died of a killed worker; none else."""
    left = progress.not_begun()
    if not left or progress.plan.tuned or not progress.launcher.endswith(_JOBLIB):
        return []
    folder = str(progress.plan.folder).replace("'", r"\'")
    return [f"sweep.resume='{folder}'", f"sweep.jobs=[{','.join(map(str, left))}]"]


def close(progress: Progress, arguments: Sequence[str]) -> int:
    """Name every job that is not complete and how to run it again; returns the sweep's exit code, 0 or 1."""
    progress.stop()
    Watch.lock.close()
    folder = progress.plan.folder
    if left := len(list((folder / ASIDE).glob(f"*/{SUMMARY}"))):
        print(f"{left} complete runs that were here are none of these jobs: moved to {folder / ASIDE}")
    if not (missing := progress.not_complete()):
        return 0
    print(f"workbench: {len(missing)} of {len(progress.plan.jobs)} jobs are not complete:", file=sys.stderr)
    for job, reason in missing.items():
        print(f"  {folder / str(job)}: {' '.join(reason.split())}", file=sys.stderr)
    again = [each for each in arguments if not each.startswith(("sweep.resume=", "hydra.sweep.dir="))]
    print(f"run them again: {shlex.join(['workbench', 'run', *again, f'sweep.resume={folder}'])}", file=sys.stderr)
    return 1


def watch(folder: Path, period_s: float = PERIOD_S) -> int:
    """Print the table of a sweep until all jobs have ended, or no process is at work in the sweep.

    Returns 0 when all jobs are complete, else 1. Raises InputError where there is no sweep, or it is removed.
    """
    plan, start = read_plan(folder), folder / PLAN
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
