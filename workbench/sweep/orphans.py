"""The process that ends the workers of a sweep whose own process was killed: `python -m workbench.sweep.orphans PID`.

Workers may have begun no job then, so that none of our code runs in them, and only Linux signals a parent's death.
"""

import sys
from contextlib import suppress
from threading import Thread

import psutil

from workbench.utils.processes import module, start

_PERIOD_S, _END_S = 0.5, 3.0
"""Period of the list of workers, and time for their runs to end after SIGTERM."""


class Guard:
    """Ends the children of the process `pid` if it ends without calling `release`."""

    def __init__(self, pid: int) -> None:
        self._process = start(module("workbench.sweep.orphans", str(pid)))

    def release(self) -> None:
        """End the guard without effect on the workers."""
        if self._process.poll() is None and self._process.stdin is not None and not self._process.stdin.closed:
            self._process.communicate(b"released")


def main(pid: int) -> None:
    """Follow the children of a process until standard input ends; if nothing was written there, end them."""
    words = list[bytes]()
    reader = Thread(target=lambda: words.append(sys.stdin.buffer.read()))
    reader.start()
    children: list[psutil.Process] = []
    while reader.is_alive():
        with suppress(psutil.Error):  # it has just ended
            children = [child for child in psutil.Process(pid).children(recursive=True) if child != psutil.Process()]
        reader.join(_PERIOD_S)
    if not any(words):
        _end(children)


def _end(processes: list[psutil.Process]) -> None:
    for process in processes:
        if process.is_running():
            process.terminate()
    _, alive = psutil.wait_procs(processes, _END_S)
    for process in alive:
        process.kill()


if __name__ == "__main__":
    main(int(sys.argv[1]))
