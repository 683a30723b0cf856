"""The processes that a sweep's jobs run in: one job after another, as long as they end well.

What a process imported, compiled and read for one job is there for the next. Nothing of a job's results depends on the
jobs before it: every random draw is from a stream of its own, and every part is built anew.
"""

import atexit
import gc
import json
import logging
import os
import shutil
import signal
import sys
import threading
import warnings
from _thread import interrupt_main
from contextlib import suppress
from pathlib import Path
from socket import recv_fds, send_fds, socket, socketpair
from subprocess import PIPE, STDOUT, Popen
from typing import Any, BinaryIO

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.parts import name_parts, packages
from workbench.signals import SIGNALS, Interrupted, interruptible
from workbench.sweep.stopping import stop_when

WARNING = signal.SIGUSR2
"""What submitit has Slurm send some time before a job's time is up, hydra.launcher.signal_delay_s, and when it is to
make room for another."""

CONFIG = Path(".hydra", "resolved.yaml")
"""In a job's folder: its configuration."""

STOP_WHEN = Path(".hydra", "stop_when")
"""In a job's folder: the condition that ended or may end it, as it was said; nothing where there is none."""

BEFORE = ".before"
"""Where in a job's folder lies what an earlier attempt at it recorded, from which it goes on, until it is complete."""

_LONGEST = 1 << 16  # bytes of what is said of a job
_MOST_JOBS = 100  # of one process: Rerun keeps threads and about 1 MB of each recording that it wrote
_waiting: list["JobProcess"] = []


class JobProcess:
    """Another Python, which runs the jobs that it is told of; it ends with this one, or when one of them does not end
    well. Started with the signals that ask to end held back, see `signals.held_back`; between jobs they are, too.

    out: what it prints until it is told of a job.
    """

    def __init__(self, out: BinaryIO) -> None:
        self._surroundings, self._n_jobs = _surroundings(), 0
        self._line, other = socketpair()
        with other:
            self._process = Popen(
                [sys.executable, "-P", "-m", __name__, str(other.fileno()), *packages()],
                stdin=PIPE, stdout=out, stderr=STDOUT, pass_fds=[other.fileno()],
            )  # fmt: skip

    def fits(self) -> bool:
        """Tell whether it is there, has not run _MOST_JOBS, and was started where a new one would be: folder,
        environment, packages named."""
        there = self._process.poll() is None and self._n_jobs < _MOST_JOBS
        return there and self._surroundings == _surroundings()

    def begin(self, experiment: str, folder: Path, lock: int, out: BinaryIO) -> None:
        """Have it run the job of a folder. It keeps the lock until the job has ended, and prints to `out`."""
        self._n_jobs += 1
        with suppress(BrokenPipeError):  # it has just ended, which `wait` tells
            send_fds(self._line, [json.dumps([experiment, str(folder)]).encode()], [lock, out.fileno()])

    def wait(self) -> int:
        """Wait until the job has ended; 0 where it ended well and the process waits for another, else its exit code."""
        with suppress(ConnectionResetError):
            if self._line.recv(1):
                _waiting.append(self)
                return 0
        return self._process.wait()

    def end(self, number: int | None = None) -> None:
        """Wait until it has ended, which it does after its job; number: of a signal that asks it to end at once."""
        self._line.close()
        if number is not None:
            self._process.send_signal(number)
        self._process.wait()


def process_for(out: BinaryIO) -> JobProcess:
    """Take a process that waits for a job, or start one."""
    while _waiting:
        if (process := _waiting.pop()).fits():
            return process
        process.end()
    return JobProcess(out)


def _surroundings() -> tuple[Any, ...]:
    return os.getcwd(), dict(os.environ), packages()


@atexit.register
def _end_all() -> None:
    while _waiting:
        _waiting.pop().end()


def main(line: int) -> None:
    """The other process. Standard input stays open as long as the one that started it lives.

    line: the file descriptor on which it is told of jobs.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    logging.captureWarnings(True)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have started the sweep with it ignored
    threading.Thread(target=_interrupt_when_orphaned, daemon=True).start()
    with socket(fileno=line) as jobs, suppress(BrokenPipeError):
        while job := _next_job(jobs):
            experiment, folder, lock = job
            _run(experiment, folder)
            gc.collect()
            sys.stdout.flush()
            os.close(lock)
            jobs.send(b"\n")


def _next_job(jobs: socket) -> tuple[str, Path, int] | None:
    """Wait for a job: its experiment, its folder, its lock; None when there will be none. Prints to where it says."""
    try:
        told, files, _, _ = recv_fds(jobs, _LONGEST, 2)
    except KeyboardInterrupt:  # from `_interrupt_when_orphaned`
        return None
    if not told:
        return None
    lock, out = files
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.close(out)
    experiment, folder = json.loads(told)
    return experiment, Path(folder), lock


def _run(experiment: str, folder: Path) -> None:
    from workbench.experiment.execute import execute  # here, as who starts jobs does without
    from workbench.experiment.provenance import command_of
    from workbench.experiment.resuming import resumed

    config = OmegaConf.load(folder / CONFIG)
    assert isinstance(config, DictConfig)
    stop = (folder / STOP_WHEN).read_text()
    command, condition = command_of(folder), stop_when(stop) if stop else None
    try:
        with interruptible(WARNING), warnings.catch_warnings():  # which tells every job's warnings anew
            attempts = list((folder / BEFORE).glob("*.rrd.part"))
            found = resumed(config, attempts)
            goes_on, anew = (None, found) if isinstance(found, str) else (found, None)
            for attempt in attempts:
                if goes_on is None or attempt != goes_on.run.path:
                    attempt.unlink()
            execute(config, experiment, folder, True, command, continued=goes_on, stop=condition, anew=anew)
            shutil.rmtree(folder / BEFORE, ignore_errors=True)
    except Interrupted as error:
        sys.exit(128 + error.number)
    signal.pthread_sigmask(signal.SIG_BLOCK, (*SIGNALS, WARNING))


def _interrupt_when_orphaned() -> None:
    os.read(0, 1)  # returns when the other end is closed
    interrupt_main()


if __name__ == "__main__":
    name_parts(sys.argv[2:])  # what a folder's configuration says of these does not count
    main(int(sys.argv[1]))
