"""What a person sees of a sweep: a line for every job that ends and, at the end, every job that is not complete."""

import os
import platform
import shlex
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any, ClassVar

from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from workbench.errors import InputError
from workbench.experiment.folder import refuse_if_taken
from workbench.sweep import starter
from workbench.sweep.halving import check_rounds
from workbench.sweep.job import CUT_OFF, ENDED, at_work, read_summary, say_if_gone
from workbench.sweep.plan import ENDING, FAILED, Plan, metric_of, plan_of, worst
from workbench.sweep.reuse import ASIDE, left_aside
from workbench.sweep.slurm import SLURM, let_slurm_end

PERIOD_S = 0.5
LONGEST_END_S = 20.0
"""That jobs have to end in when asked to, before their launcher kills them."""
_ELSEWHERE = ("BasicLauncher", SLURM)
"""Ends of the names of launchers whose jobs are told by who waits for them, or that go on by themselves."""
_ORPHANED = f"Interrupted: {signal.SIGINT.name}"
"""What a job's summary says that ended because the process that had started it is gone, see `process.main`."""


class Progress:
    """The jobs of a sweep as their folders tell, which every launcher leaves alike.

    Job k has ended when `k/summary.json` was written, or marked as looked at, since the sweep began and its status is
    one of ENDED; one that was interrupted may begin again, as submitit has Slurm do. `after`: the progress of the same
    sweep before its launcher died. `launcher`: its name.
    """

    def __init__(self, plan: Plan, after: "Progress | None" = None, launcher: str = "") -> None:
        self.plan, self._launcher = plan, launcher
        self.jobs: tuple[int, ...] = after.jobs if after else plan.jobs
        self.ended: dict[int, str] = after.ended if after else {}
        self._before = {job: (self._written(job), (read_summary(plan.folder / str(job)) or {}).get("started"))
                        for job in plan.jobs}  # fmt: skip
        self._over = Event()
        self._thread = Thread(target=self._watch, daemon=True)
        if after is None:
            print(f"{len(self.jobs)} jobs in {plan.folder}")
            print(f" job  status       {plan.metric or 'error':>14}  seconds   left   verdict", flush=True)
        self._thread.start()

    def stop(self) -> None:
        """Print what has ended by now, and no more."""
        self._over.set()
        self._thread.join()

    def end_jobs(self) -> None:
        """Ask the jobs that a launcher's processes on this machine run to end, and wait until they have; no more begin.

        Else the launcher would kill them with its processes before they have closed their recordings.
        """
        if self._launcher.endswith(SLURM):
            starter.leave(self.plan.folder)
        if self._launcher.endswith(_ELSEWHERE):
            return
        folder, latest, asked = self.plan.folder, monotonic() + LONGEST_END_S, set[int]()
        (folder / ENDING).touch()
        while (busy := [job for job in self.cut() if at_work(folder / str(job))]) and monotonic() < latest:
            for job in busy:
                summary, (_, earlier) = read_summary(folder / str(job)) or {}, self._before.get(job, (0, None))
                here = (summary.get("status"), summary.get("host")) == ("running", platform.node())
                if here and summary["started"] != earlier and summary["pid"] not in asked:
                    asked.add(summary["pid"])
                    with suppress(ProcessLookupError):
                        os.kill(summary["pid"], signal.SIGTERM)
            sleep(0.1)

    def not_complete(self) -> dict[int, str]:
        """One sentence for every job that is not complete."""
        return {
            job: self._sentence(job) for job in self.jobs if self.ended.get(job) not in ("complete", "kept", "stopped")
        }

    def cut(self) -> list[int]:
        """The jobs that have not ended: cut off with their launcher, or never begun."""
        return [job for job in self.jobs if job not in self.ended]

    def forget_cut_off(self) -> None:
        """Count the jobs that a launcher which has died took with it as not ended; waits until they have noticed.

        Each of them interrupts itself with SIGINT; asked by a person, the whole sweep would end.
        """
        latest = monotonic() + LONGEST_END_S
        while any(at_work(self.plan.folder / str(job)) for job in self.cut()) and monotonic() < latest:
            sleep(0.1)
        for job in self.jobs:
            summary = read_summary(self.plan.folder / str(job)) or {}
            if (summary.get("status"), summary.get("error")) == ("interrupted", _ORPHANED):
                self.ended.pop(job, None)

    def _watch(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            for job in self.jobs:
                if self.ended.get(job) in (None, "interrupted"):
                    self._look(job)

    def _look(self, job: int) -> None:
        written, (was_written, was_started) = self._written(job), self._before.get(job, (0, None))
        summary = (read_summary(self.plan.folder / str(job)) if written != was_written else None) or {}
        if summary:
            self.ended.pop(job, None)
        if summary.get("status") not in ENDED:
            return
        self._before[job] = written, was_started
        same = "taken_from" in summary or summary.get("started", "") == was_started
        self.ended[job] = "kept" if same else summary["status"]
        try:
            metric = metric_of(summary.get("metrics", {}), self.plan.metric)
        except InputError:
            metric = None
        shown = "-" if metric is None or summary["status"] != "complete" else f"{metric:.4g}"
        line = f"{job:4d}  {self.ended[job]:<11}  {shown:>14}  {summary.get('wall_s', 0.0):7.1f}  {len(self.cut()):5d}"
        kind = str((summary.get("verdict") or {}).get("kind", "-")) if summary["status"] == "complete" else "-"
        print(f"{line}   {kind:<16}   {self.plan.of(job)}{'' if same else _how(summary)}", flush=True)

    def _written(self, job: int) -> int:
        try:
            return (self.plan.folder / str(job) / "summary.json").stat().st_mtime_ns
        except OSError:
            return 0

    def _sentence(self, job: int) -> str:
        summary = read_summary(self.plan.folder / str(job)) or {}
        if job not in self.ended:
            return {"running": "cut off", "failed": CUT_OFF}.get(str(summary.get("status")), "never begun")
        if summary["status"] == "failed":
            return str(summary["error"])
        by = str(summary.get("error") or "").partition(": ")[2]
        return f"interrupted by {by}" if by else "interrupted"


def _how(summary: Mapping[str, Any]) -> str:
    """Tell whether a job went on with an earlier attempt, or why it did not."""
    if continued := (summary.get("provenance") or {}).get("continued"):
        return f"  (went on from frame {str(continued).rpartition('@')[2]})"
    return f"  (begun anew: {summary['anew']})" if summary.get("anew") else ""


class Watch(Callback):
    """Tells Progress when Hydra starts a sweep. Hydra makes these objects itself and sends them to its workers."""

    progress: ClassVar[Progress | None] = None
    """Of the sweep that this process runs."""
    rounds: ClassVar[Sequence[int]] = ()
    """Frames of the rounds that are about to begin, which are checked with the first."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        """Refuse the folder of another run that is at work, before Hydra writes into it what this one is."""
        try:
            refuse_if_taken(Path(config.hydra.run.dir))
        except (InputError, OSError, OmegaConfBaseException) as error:
            print(f"workbench: {error}", file=sys.stderr)
            sys.exit(2)

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Check the sweep and watch it; ends the command with code 2 when it is not to be started."""
        try:
            plan = plan_of(config)
            if Watch.rounds:
                check_rounds(config, plan, Watch.rounds)
                Watch.rounds = ()
        except (InputError, HydraException, OmegaConfBaseException) as error:
            print(f"workbench: {error}", file=sys.stderr)
            sys.exit(2)  # Hydra makes a warning of any other exception
        if str(config.hydra.launcher._target_).endswith(SLURM) and Watch.progress is None:
            let_slurm_end(worst(config.hydra.sweeper))
        if Watch.progress is None:
            (plan.folder / FAILED).unlink(missing_ok=True)
        (plan.folder / ENDING).unlink(missing_ok=True)
        launcher = str(config.hydra.launcher._target_)
        starter.begin(plan.folder, needed=not launcher.endswith(SLURM))
        Watch.progress = Progress(plan, after=Watch.progress, launcher=launcher)

    @classmethod
    def end(cls) -> None:
        """End the jobs of the sweep that this process runs, if it runs one."""
        if cls.progress is not None:
            cls.progress.end_jobs()


def rest_of(progress: Progress) -> list[str]:
    """The overrides that run what is left after the launcher died; none when a tuner chose the jobs."""
    progress.forget_cut_off()
    folder = str(progress.plan.folder).replace("'", r"\'")
    left = progress.cut() if progress.plan.varied is not None else []
    return [f"sweep.resume='{folder}'", f"sweep.jobs=[{','.join(map(str, left))}]"] if left else []


def close(progress: Progress, arguments: list[str]) -> int:
    """Name every job that is not complete and say how to run it again; returns the sweep's exit code, 0 or 1."""
    folder = progress.plan.folder
    if left := left_aside(folder):
        print(f"{left} complete runs that were here are none of these jobs: kept in {folder / ASIDE}")
    for job in progress.cut():
        say_if_gone(folder / str(job))
    starter.end(folder)
    if not (missing := progress.not_complete()):
        return 0
    print(f"workbench: {len(missing)} of {len(progress.jobs)} jobs are not complete:", file=sys.stderr)
    for job, sentence in missing.items():
        print(f"  {folder / str(job)}: {' '.join(sentence.split())}", file=sys.stderr)
    again = [each for each in arguments if not each.startswith(("sweep.resume=", "hydra.sweep.dir="))]
    print(f"run them again: {shlex.join(['workbench', *again, f'sweep.resume={folder}'])}", file=sys.stderr)
    return 1
