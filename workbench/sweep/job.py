"""One job of a sweep, in a process of its own: however violently it ends, the sweep and its other jobs go on."""

import fcntl
import json
import logging
import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE, STDOUT, Popen
from time import perf_counter
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.parts import name_parts, packages
from workbench.files import whole_file

ENDED = ("complete", "failed", "interrupted")
"""What `status` in summary.json comes to; before that it is "running"."""

KILLED = "killed by"
"""How the error of a job begins that a signal ended."""

_CONFIG = Path(".hydra", "resolved.yaml")


@contextmanager
def alone(folder: Path) -> Iterator[int]:
    """Wait until no other process works in the folder, then keep others waiting; gives the lock's file descriptor.

    A process that inherits the descriptor keeps the lock until it ends, too.
    """
    with (folder / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file.fileno()


def run_apart(config: DictConfig, experiment: str, folder: Path, output: Path, lock: int) -> None:
    """Run the configured experiment in another process, which leaves run.rrd and summary.json in `folder`.

    What it prints is added to the file `output`. The process inherits `lock`. Whatever becomes of it, summary.json
    says so afterwards: "failed" with the signal or the exit code where it could not say so itself.
    """
    (folder / _CONFIG).parent.mkdir(exist_ok=True)
    (folder / _CONFIG).write_text(OmegaConf.to_yaml(config, resolve=True))
    (folder / "summary.json").unlink(missing_ok=True)  # an earlier attempt's, which says nothing about this one
    began = perf_counter()
    command = [sys.executable, "-P", "-m", __name__, experiment, str(folder), *packages()]
    with output.open("ab") as out, Popen(command, stdin=PIPE, stdout=out, stderr=STDOUT, pass_fds=[lock]) as process:
        try:
            code = process.wait()
        except KeyboardInterrupt:  # the terminal sends it to both
            process.wait()
            raise
    summary = read_summary(folder) or {"experiment": experiment, "metrics": {}}
    if summary.get("status") not in ENDED:
        cause = f"{KILLED} {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}, see {output.name}"
        write_failure(folder, cause, {**summary, "wall_s": round(perf_counter() - began, 3)})


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Read what summary.json in the folder says; None where there is none or it cannot be read."""
    try:
        summary = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError):
        return None
    return summary if isinstance(summary, dict) else None


def write_failure(folder: Path, error: str, summary: dict[str, Any]) -> None:
    """Write the summary again as that of a failed run."""
    with whole_file(folder / "summary.json") as part:
        part.write_text(json.dumps({**summary, "status": "failed", "error": error}, indent=2) + "\n")


def main(arguments: Sequence[str]) -> None:
    """The other process. Standard input stays open as long as the one that started it lives.

    arguments: the experiment's name, the folder, and the packages that may be built from: what the folder's
    configuration says of these does not count.
    """
    from workbench.experiment.execute import execute  # here, as who starts jobs does without
    from workbench.experiment.provenance import command_of

    experiment, folder = arguments[0], Path(arguments[1])
    name_parts(arguments[2:])
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    logging.captureWarnings(True)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have started the sweep with it ignored
    threading.Thread(target=_interrupt_when_orphaned, daemon=True).start()
    config = OmegaConf.load(folder / _CONFIG)
    assert isinstance(config, DictConfig)
    execute(config, experiment, folder, quiet=True, command=command_of(folder))


def _interrupt_when_orphaned() -> None:
    os.read(0, 1)  # returns when the other end is closed
    interrupt_main()


if __name__ == "__main__":
    main(sys.argv[1:])
