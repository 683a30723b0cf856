"""Parse untrusted files in a child process with limits on time, memory and output; on Windows on time and memory.

Some damaged files make C libraries crash, loop or exhaust the memory. The child returns NPZ, read without pickle.
"""

import os
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from workbench.utils.arrays import AnyArray
from workbench.utils.errors import InputError
from workbench.utils.process_limits import CAN_LIMIT, limit_process, run_watched
from workbench.utils.processes import module, run

_CPU_S, _BYTES_PER_S = 5, 5_000_000  # processor time of the child: 5 s, and 1 s for every 5 MB
MEMORY_BYTES = 4_000_000_000  # of the child, and of its output, plus ten times the size of the files
_WALL = 20  # wall time over processor time
_INPUT_ERROR, _LARGEST_CODE = 3, 255  # exit codes of the child after an InputError, and without a crash on Windows


def parse_limited(parse: Callable[..., Mapping[str, AnyArray]], *paths: Path, what: str) -> dict[str, AnyArray]:
    """Return the arrays of numbers or texts that a module-level function returns for the paths in a child process.

    Raises InputError if it raises any error, crashes or exceeds a limit. what: the expected kind of file.
    """
    place, size = f"{paths[0]}: expected {what}", sum(path.stat().st_size for path in paths if path.exists())
    call, wall_s = (f"{parse.__module__}:{parse.__qualname__}", str(size)), _WALL * (_CPU_S + size // _BYTES_PER_S)
    command = module(__name__, *call, *map(str, paths))
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        try:
            code = _exit_code(command, _memory_bytes(size), wall_s, stdout=output, stderr=errors)
        except TimeoutError:
            raise InputError(f"{place}, found a file that takes more than {wall_s} s to read") from None
        if code < 0 or code > _LARGEST_CODE:
            raise InputError(f"{place}, found damage that crashes the reader or takes too much time or memory")
        if code:
            errors.seek(max(0, errors.seek(0, os.SEEK_END) - 10_000))
            last = (errors.read().decode("utf-8", "replace").strip().splitlines() or ["no message"])[-1]
            raise InputError(last if code == _INPUT_ERROR else f"{place}: {last}")
        try:
            with zipfile.ZipFile(output) as packed:
                if sum(entry.file_size for entry in packed.infolist()) > os.fstat(output.fileno()).st_size:
                    raise ValueError("compressed data")
            with np.load(output, allow_pickle=False) as arrays:
                return dict(arrays)
        except Exception as error:  # noqa: BLE001 (a malicious file can make its reader write anything)
            raise InputError(f"{place}, found a file whose reader returned no arrays: {error}") from None


def _memory_bytes(size: int) -> int:
    """Return the limit of the child's memory and output for files of a size, bytes."""
    return MEMORY_BYTES + 10 * size


def _exit_code(command: Sequence[str], memory_bytes: int, wall_s: float, **outputs: Any) -> int:
    if CAN_LIMIT:  # the child limits itself
        return run(command, timeout_s=wall_s, **outputs).returncode
    return run_watched(command, memory_bytes=memory_bytes, timeout_s=wall_s, **outputs)


def main(name: str, size: str, *paths: str) -> None:
    """Call package.module:function within the limits for `size` bytes, and write its arrays to standard output."""
    parse, cpu_s = resolve_name(name), _CPU_S + int(size) // _BYTES_PER_S + int(time.process_time()) + 1
    limit_process(_memory_bytes(int(size)), cpu_s)
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # output of libraries is no result
        try:
            np.savez(output, **parse(*map(Path, paths)))
        except Exception as error:  # noqa: BLE001 (damage leads to any error; the parent reports it)
            is_input_error = isinstance(error, InputError)
            message = f"{error}" if is_input_error else f"{type(error).__name__}: {error}"
            print("\n" + " ".join(message.split()), file=sys.stderr)
            sys.exit(_INPUT_ERROR if is_input_error else 1)


if __name__ == "__main__":
    main(*sys.argv[1:])
