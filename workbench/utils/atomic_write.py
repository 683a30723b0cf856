"""Files that appear whole or not at all."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from workbench.utils.errors import InputError, shortened


class NotWrittenError(InputError):
    """A file cannot be written."""


def replace_text(path: Path, text: str, shorter: str = "") -> None:
    """Replace a file by an ASCII text; on a full disk within its size, by `shorter` where `text` is too long for it.

    Raises InputError when neither is possible.
    """
    try:
        with whole_file(path) as part:
            part.write_text(text)
    except InputError:
        room = path.stat().st_size if path.is_file() else 0
        fitting = next((each for each in (text, shorter) if 0 < len(each) <= room), None)
        if fitting is None:
            raise
        with path.open("r+") as file:
            file.write(fitting.ljust(room))


@contextmanager
def whole_file(path: Path, parents: bool = False) -> Iterator[Path]:
    """Yield a name next to `path` to write to, which becomes `path` when the block ends well, else is removed.

    The name is the process's own, so that several may write the same file. parents: make the folder too.
    Raises InputError when the file cannot be written.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        os.replace(part, path)
    except OSError as error:
        raise NotWrittenError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if part.is_file():
            part.unlink(missing_ok=True)  # its folder may be removed just now


@contextmanager
def optional_cache() -> Iterator[None]:
    """Write to a cache in the block; where that is not possible, warn once and go on."""
    try:
        yield
    except (NotWrittenError, OSError, RuntimeError) as error:  # the last is h5py's, of a full disk
        warn_once(shortened(f"{' '.join(str(error).split())}; the run goes on, and the next one makes it again"))


@cache
def warn_once(sentence: str) -> None:
    """Log a warning unless it was logged before."""
    logging.getLogger(__name__).warning(sentence)
