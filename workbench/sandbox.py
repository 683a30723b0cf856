"""Parse untrusted files in a child process with limits on time, memory and output.

Some damaged files make C libraries crash, loop or exhaust the memory. Results come back as NPZ, read without pickle.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import IO

import numpy as np

from workbench.arrays import AnyArray
from workbench.errors import InputError

CPU_S, BYTES_PER_S = 5, 5_000_000  # processor time of the child: 5 s, and 1 s for every 5 MB
MEMORY_BYTES = 4_000_000_000  # of the child, and of its output, plus ten times the size of the files
_WALL = 20  # wall time over processor time
_REFUSED = 3  # exit code of the child after an InputError


def parse_limited(parse: Callable[..., Mapping[str, AnyArray]], *paths: Path, what: str) -> dict[str, AnyArray]:
    """Return the arrays of numbers or texts that a module-level function, called with paths in a child, returns.

    Raises InputError where it raises any error, crashes or exceeds a limit. what: the expected kind of file.
    """
    place, wall_s = f"{paths[0]}: expected {what}", _WALL * (CPU_S + _size(paths) // BYTES_PER_S)
    command = [sys.executable, "-P", "-m", __name__, f"{parse.__module__}:{parse.__qualname__}", *map(str, paths)]
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        try:
            code = subprocess.run(command, stdout=output, stderr=errors, timeout=wall_s, check=False).returncode
        except subprocess.TimeoutExpired:
            raise InputError(f"{place}, found one that takes more than {wall_s} s to read") from None
        if code < 0:
            raise InputError(f"{place}, found damage that crashes the reader or takes too much time or memory")
        if code:
            errors.seek(max(0, errors.seek(0, os.SEEK_END) - 10_000))
            last = (errors.read().decode("utf-8", "replace").strip().splitlines() or ["no message"])[-1]
            raise InputError(last if code == _REFUSED else f"{place}: {last}")
        try:
            return _arrays(output)
        except Exception as error:  # noqa: BLE001 (a file that took over its reader can make it write anything)
            raise InputError(f"{place}, found one whose reader returned no arrays: {error}") from None


def _arrays(output: IO[bytes]) -> dict[str, AnyArray]:
    with zipfile.ZipFile(output) as packed:
        if sum(each.file_size for each in packed.infolist()) > os.fstat(output.fileno()).st_size:
            raise ValueError("compressed data")
    with np.load(output, allow_pickle=False) as arrays:
        return dict(arrays)


def _size(paths: Iterable[Path]) -> int:
    return sum(path.stat().st_size for path in paths)


def main(name: str, *paths: str) -> None:
    """Call the function package.module:function within the limits and write its arrays to standard output."""
    parse, files = (
        getattr(import_module(name.partition(":")[0]), name.partition(":")[2]),
        [Path(path) for path in paths],
    )
    memory, cpu_s = MEMORY_BYTES + 10 * _size(files), CPU_S + _size(files) // BYTES_PER_S + int(time.process_time()) + 1
    for limit, most in {"DATA": memory, "FSIZE": memory, "CPU": cpu_s, "CORE": 0}.items():
        number = getattr(resource, f"RLIMIT_{limit}")
        hard = resource.getrlimit(number)[1]
        resource.setrlimit(number, (most if hard == resource.RLIM_INFINITY else min(most, hard),) * 2)
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # what a library prints is no result
        try:
            np.savez(output, **parse(*files))
        except Exception as error:  # noqa: BLE001 (damage leads to any error; the parent reports it)
            known = isinstance(error, InputError)
            sentence = f"{error}" if known else f"{type(error).__name__}: {error}"
            print("\n" + " ".join(sentence.split()), file=sys.stderr)
            sys.exit(_REFUSED if known else 1)


if __name__ == "__main__":
    main(*sys.argv[1:])
