"""Start processes: wait for one, or run one in the background."""

import subprocess
import sys
from collections.abc import Sequence
from typing import Any

CAPTURED = subprocess.PIPE


def module(name: str, *arguments: str) -> list[str]:
    """Return the command that runs a module with this Python, without the current folder in the import path."""
    return [sys.executable, "-P", "-m", name, *arguments]


def run(
    command: Sequence[str], *, timeout_s: float | None = None, **options: Any
) -> subprocess.CompletedProcess[bytes]:
    """Run a command to its end and return the completed process; after `timeout_s` it is killed.

    options: of `subprocess.run`, such as stdout and stderr (CAPTURED: in the result), cwd and env.
    Raises OSError if it cannot be started, TimeoutError if it was killed.
    """
    try:
        return subprocess.run(command, timeout=timeout_s, check=False, **options)
    except subprocess.TimeoutExpired:
        raise TimeoutError(f"{command[0]}: killed after the time limit of {timeout_s:g} s") from None


def start(command: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start a command in the background with a pipe as standard input, and return the process without waiting.

    Its outputs are discarded, and signals of the terminal do not reach it.
    """
    null = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=null, stderr=null, start_new_session=True)


def end(process: subprocess.Popen[bytes], timeout_s: float) -> int:
    """Close a started process's standard input and return its exit code; after `timeout_s` it is killed."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        return process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()
