"""Reading a stranger's file in a process of its own first: C libraries run for ever on some damaged files, fill the
memory, or end whoever calls them."""

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from workbench.errors import InputError

_CPU_S = 4
_BYTES_A_SECOND = 20_000_000
_MEMORY_BYTES = 900_000_000
_LONGEST_S = 600.0  # where the machine has no time for it


def read_apart(module: str, path: Path, what: str) -> bytes:
    """Run `python -m module PATH`, see `bounded`, and return what it prints; raises InputError where it is refused."""
    command = [sys.executable, "-P", "-m", module, str(path.resolve())]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: expected {what}, found one that is not read in {_LONGEST_S:.0f} s") from None
    if done.returncode < 0:
        raise InputError(f"{path}: expected {what}, found damage that ends whoever reads it or takes for ever")
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:] or ["nothing"]
        raise InputError(f"{path}: expected {what}: {said[0].removeprefix(f'{path.resolve()}: ')}")
    return done.stdout


def bounded(path: str, read: Callable[[Path], bytes]) -> None:
    """Read a file, in the other process, with bounded time and memory, and print what comes of it or why not."""
    size = Path(path).stat().st_size
    memory, cpu_s = _MEMORY_BYTES + 40 * size, _CPU_S + size // _BYTES_A_SECOND
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        content = read(Path(path))
    except Exception as error:  # noqa: BLE001 (whatever it ends of, whoever asked says it in a sentence)
        told = f"{error}" if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        print(" ".join(told.split()), file=sys.stderr)
        sys.exit(1)
    sys.stdout.buffer.write(content)
