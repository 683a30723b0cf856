"""Reading a stranger's file in a process of its own: C libraries run for ever on some damaged files, fill the memory,
or end whoever calls them. What they make of it is taken over from there."""

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from workbench.errors import InputError
from workbench.limits import check_number

_CPU_S = 4
_BYTES_A_SECOND = 20_000_000
_MEMORY_BYTES = 900_000_000
_LONGEST_S = 600.0  # where the machine has no time for it
_LENGTH_BYTES = 8


def read_apart(module: str, path: Path, what: str) -> bytes:
    """Run `python -m module PATH`, see `bounded`, and return what it prints; raises InputError where it is refused."""
    try:
        done = subprocess.run(_command(module, path), capture_output=True, timeout=_LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: expected {what}, found one that is not read in {_LONGEST_S:.0f} s") from None
    if done.returncode:
        raise _refusal(path, what, done.returncode, done.stderr)
    return done.stdout


@contextmanager
def asked_apart(module: str, path: Path, what: str) -> Iterator[Callable[[str, int], bytearray]]:
    """Run `python -m module PATH`, see `bounded` and `answer`, and give a function that asks it: a line, and how many
    bytes the answer may have. It raises InputError where the other process refuses the file or ends."""
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(_command(module, path), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said) as process,
    ):
        assert process.stdin is not None
        assert isinstance(process.stdout, BufferedReader)
        questions, answers = process.stdin.fileno(), process.stdout

        def ask(question: str, most: int) -> bytearray:
            try:
                os.write(questions, f"{question}\n".encode())
                length = answers.read(_LENGTH_BYTES)
                if len(length) == _LENGTH_BYTES:
                    check_number(path, "bytes of an answer", size := int.from_bytes(length, "little"), most)
                    if answers.readinto(content := bytearray(size)) == size:
                        return content
            except BrokenPipeError:
                pass
            code = process.wait()
            said.seek(0)
            raise _refusal(path, what, code, said.read())

        try:
            yield ask
        finally:
            process.kill()


def _command(module: str, path: Path) -> list[str]:
    return [sys.executable, "-P", "-m", module, str(path.resolve())]


def _refusal(path: Path, what: str, code: int, told: bytes) -> InputError:
    """What to say of a file whose reader ended so, and told that."""
    if code < 0:
        return InputError(f"{path}: expected {what}, found damage that ends whoever reads it or takes for ever")
    said = told.decode("utf-8", "replace").strip().splitlines()[-1:] or ["nothing"]
    return InputError(f"{path}: expected {what}: {said[0].removeprefix(f'{path.resolve()}: ')}")


def answer(reply: Callable[[str], bytes | memoryview]) -> None:
    """Answer every line that is asked, in the other process, by how many bytes there are and these."""
    for question in sys.stdin:
        content = memoryview(reply(question.strip()))
        sys.stdout.buffer.write(content.nbytes.to_bytes(_LENGTH_BYTES, "little"))
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()


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
