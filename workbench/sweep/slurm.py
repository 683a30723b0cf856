"""Sweeps on Slurm that end by themselves, with accounting or without, whatever becomes of their jobs.

Hydra's launcher has submitit submit the jobs and wait for each to write a result. A job that Slurm ends at once (out of
memory, a lost node, SIGKILL) writes none. submitit then asks `sacct`, which on a cluster without accounting answers
nothing, so that it would wait for ever; and where it gets an answer it raises, and nobody waits for the other jobs.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from subprocess import CalledProcessError
from typing import Any, TypeAlias

from hydra.core.utils import JobReturn, JobStatus

SLURM = "SlurmLauncher"
"""How the name of submitit's launcher for Slurm ends."""

GONE = "GONE"
"""State of a job that Slurm has forgotten: it ended longer than Slurm's MinJobAge ago, usually 300 s."""

MOST_SECONDS = 60
"""Between two questions to Slurm's controller."""

Results: TypeAlias = Callable[[Any], list[Any]]

HEADER = "JobID|State|NodeList"


def let_slurm_end(worst: float) -> None:
    """Have submitit wait for all jobs and, while `sacct` does not work, ask Slurm's controller what became of them.

    worst: the number of a job that Slurm has ended, for a tuner.
    """
    from submitit.slurm import slurm  # here, as it belongs to an extra

    job_class: Any = slurm.SlurmJob
    job_class.results = _patient(job_class.results, worst)
    job_class.watcher = _watcher()


def accounts_of(jobs: list[str]) -> str:
    """What `sacct` prints of jobs and arrays of jobs, by number; raises CalledProcessError or OSError where it does not
    work."""
    command = ["sacct", f"--format={HEADER.replace('|', ',')}", "--parsable2", f"--jobs={','.join(jobs)}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def states_of(jobs: list[str]) -> str:
    """What `sacct` would print of jobs and arrays of jobs, by number, from what the controller still knows.

    Raises CalledProcessError or OSError where the controller does not answer.
    """
    return "\n".join([HEADER, *(line for job in jobs for line in _states(job))])


def _states(job: str) -> Iterator[str]:
    done = subprocess.run(["scontrol", "show", "job", "--oneliner", job], capture_output=True, text=True, check=False)
    if "Invalid job id" in done.stderr:
        yield f"{job}|{GONE}|"
        return
    done.check_returncode()
    for line in done.stdout.splitlines():
        words = dict(word.partition("=")[::2] for word in line.split(" ") if "=" in word)
        if "JobState" in words:
            yield f"{_name(words)}|{words['JobState']}|{words.get('NodeList', '')}"


def _name(words: dict[str, str]) -> str:
    """As `sacct` names it: 7, 7_3, or 7_[4-9%2] for those of an array that wait together."""
    if (task := words.get("ArrayTaskId")) is None:
        return words["JobId"]
    return f"{words['ArrayJobId']}_{task}" if task.isdecimal() else f"{words['ArrayJobId']}_[{task}]"


def _told(jobs: list[str]) -> str:
    with suppress(OSError, CalledProcessError):
        return accounts_of(jobs)
    return states_of(jobs)


def _watcher() -> Any:
    """Make submitit's watcher of states, which asks seldom enough, ask the controller where accounts are not told."""
    from submitit.core.logger import get_logger
    from submitit.slurm.slurm import SlurmInfoWatcher

    class Watcher(SlurmInfoWatcher):
        def update(self) -> None:
            jobs = sorted({job.partition("_")[0] for job in self._registered - self._finished})
            try:
                self._info_dict.update(self.read_info(_told(jobs)))
            except (OSError, CalledProcessError) as error:
                get_logger().warning("Slurm's controller does not answer, asked again later: %s", error)
            self._last_status_check = time.time()
            self._finished |= {job for job in self._registered if self.is_done(job, mode="cache")}

        def get_info(self, job_id: str, mode: str = "standard") -> dict[str, str]:
            found = super().get_info(job_id, mode)
            return found or self._info_dict.get(job_id.partition("_")[0], {})  # of an array that is gone

    return Watcher(delay_s=MOST_SECONDS)


def _patient(results: Results, worst: float) -> Results:
    """Make of SlurmJob.results one that gives the worst number where Slurm ended the job."""
    from submitit.core.utils import FailedJobError, UncompletedJobError

    def wait(job: Any) -> list[Any]:
        try:
            found = results(job)
            if not isinstance(found[0]._return_value, UncompletedJobError):  # submitit, told that its time is up
                return found
        except FailedJobError:  # a defect
            raise
        except UncompletedJobError:
            print(f"workbench: Slurm's job {job.job_id} left no result, its state is {job.state}", file=sys.stderr)
        return [JobReturn(status=JobStatus.COMPLETED, _return_value=worst)]

    return wait
