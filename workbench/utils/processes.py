"""Start other processes: wait for one, let one go on, or share tasks among several."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

CAPTURED = subprocess.PIPE


def module(name: str, *arguments: str) -> list[str]:
    """Return the command that runs a module by this Python, without the current folder among its imports."""
    return [sys.executable, "-P", "-m", name, *arguments]


def run(
    command: Sequence[str], *, timeout_s: float | None = None, **options: Any
) -> subprocess.CompletedProcess[bytes]:
    """Run a command to its end; after `timeout_s` it is killed.

    options: of `subprocess.run`, such as stdout and stderr (CAPTURED: in the result), cwd and env.
    Raises OSError where it cannot be started, or (TimeoutError) was killed.
    """
    try:
        return subprocess.run(command, timeout=timeout_s, check=False, **options)
    except subprocess.TimeoutExpired:
        raise TimeoutError(f"{command[0]}: ended, as it took longer than {timeout_s:g} s") from None


def start(command: Sequence[str], *, background: bool = False, pass_fds: Sequence[int] = ()) -> subprocess.Popen[bytes]:
    """Start a command that reads its standard input from a pipe, and do not wait for it.

    background: discard its outputs, and keep a terminal's signals from it. pass_fds: open files that it inherits.
    """
    output = subprocess.DEVNULL if background else None
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=output, stderr=output, start_new_session=background, pass_fds=pass_fds
    )


def end(process: subprocess.Popen[bytes], timeout_s: float) -> int:
    """Close a started process's standard input and return its exit code; it is killed after the time."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        return process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def pool(n: int, prepare: Callable[..., None], *arguments: Any) -> ProcessPoolExecutor:
    """Return an executor of n new processes, each of which calls `prepare` with the arguments first."""
    return ProcessPoolExecutor(n, get_context("spawn"), prepare, arguments)
