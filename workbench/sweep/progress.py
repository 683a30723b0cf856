"""What a person sees of a sweep: a line for every job that ends and, at the end, every job that is not complete."""

import shlex
import sys
from threading import Event, Thread
from typing import Any, ClassVar

from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from workbench.errors import InputError
from workbench.sweep.job import ENDED, read_summary
from workbench.sweep.plan import FAILED, Plan, metric_of, plan_of
from workbench.sweep.reuse import ASIDE, left_aside

PERIOD_S = 0.5


class Progress:
    """The jobs of a sweep as their folders tell, which every launcher leaves alike.

    Job k has ended when `k/summary.json` was written, or marked as looked at, since the sweep began and its status is
    one of ENDED. `after`: the progress of the same sweep before its launcher died.
    """

    def __init__(self, plan: Plan, after: "Progress | None" = None) -> None:
        self.plan = plan
        self.jobs: tuple[int, ...] = after.jobs if after else plan.jobs
        self.ended: dict[int, str] = after.ended if after else {}
        self._before = {job: (self._written(job), (read_summary(plan.folder / str(job)) or {}).get("started"))
                        for job in plan.jobs}  # fmt: skip
        self._over = Event()
        self._thread = Thread(target=self._watch, daemon=True)
        if after is None:
            print(f"{len(self.jobs)} jobs in {plan.folder}")
            print(f" job  status       {plan.metric or 'error':>14}  seconds   left", flush=True)
        self._thread.start()

    def stop(self) -> None:
        """Print what has ended by now, and no more."""
        self._over.set()
        self._thread.join()

    def not_complete(self) -> dict[int, str]:
        """One sentence for every job that is not complete."""
        return {job: self._sentence(job) for job in self.jobs if self.ended.get(job) not in ("complete", "kept")}

    def cut(self) -> list[int]:
        """The jobs that have not ended: cut off with their launcher, or never begun."""
        return [job for job in self.jobs if job not in self.ended]

    def _watch(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            for job in self.cut():
                self._look(job)

    def _look(self, job: int) -> None:
        written, (was_written, was_started) = self._written(job), self._before.get(job, (0, None))
        summary = (read_summary(self.plan.folder / str(job)) if written != was_written else None) or {}
        if summary.get("status") not in ENDED:
            return
        same = "taken_from" in summary or summary.get("started", "") == was_started
        self.ended[job] = "kept" if same else summary["status"]
        try:
            metric = metric_of(summary.get("metrics", {}), self.plan.metric)
        except InputError:
            metric = None
        shown = "-" if metric is None or summary["status"] != "complete" else f"{metric:.4g}"
        line = f"{job:4d}  {self.ended[job]:<11}  {shown:>14}  {summary.get('wall_s', 0.0):7.1f}  {len(self.cut()):5d}"
        print(f"{line}   {self.plan.of(job)}", flush=True)

    def _written(self, job: int) -> int:
        try:
            return (self.plan.folder / str(job) / "summary.json").stat().st_mtime_ns
        except OSError:
            return 0

    def _sentence(self, job: int) -> str:
        summary = read_summary(self.plan.folder / str(job)) or {}
        if job not in self.ended:
            return "cut off" if summary.get("status") == "running" else "never begun"
        return str(summary["error"]) if summary["status"] == "failed" else "interrupted"


class Watch(Callback):
    """Tells Progress when Hydra starts a sweep. Hydra makes these objects itself and sends them to its workers."""

    progress: ClassVar[Progress | None] = None
    """Of the sweep that this process runs."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Check the sweep and watch it; ends the command with code 2 when it is not to be started."""
        try:
            plan = plan_of(config)
        except (InputError, HydraException, OmegaConfBaseException) as error:
            print(f"workbench: {error}", file=sys.stderr)
            sys.exit(2)  # Hydra makes a warning of any other exception
        if Watch.progress is None:
            (plan.folder / FAILED).unlink(missing_ok=True)
        Watch.progress = Progress(plan, after=Watch.progress)


def rest_of(progress: Progress) -> list[str]:
    """The overrides that run what is left after the launcher died; none when a tuner chose the jobs."""
    folder = str(progress.plan.folder).replace("'", r"\'")
    left = progress.cut() if progress.plan.varied is not None else []
    return [f"sweep.resume='{folder}'", f"sweep.jobs=[{','.join(map(str, left))}]"] if left else []


def close(progress: Progress, arguments: list[str]) -> int:
    """Name every job that is not complete and say how to run it again; returns the sweep's exit code, 0 or 1."""
    folder = progress.plan.folder
    if left := left_aside(folder):
        print(f"{left} complete runs that were here are none of these jobs: kept in {folder / ASIDE}")
    if not (missing := progress.not_complete()):
        return 0
    print(f"workbench: {len(missing)} of {len(progress.jobs)} jobs are not complete:", file=sys.stderr)
    for job, sentence in missing.items():
        print(f"  {folder / str(job)}: {' '.join(sentence.split())}", file=sys.stderr)
    again = [each for each in arguments if not each.startswith(("sweep.resume=", "hydra.sweep.dir="))]
    print(f"run them again: {shlex.join(['workbench', *again, f'sweep.resume={folder}'])}", file=sys.stderr)
    return 1
