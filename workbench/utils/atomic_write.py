"""Atomic writing of files: a file is complete or absent."""

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from workbench.utils.errors import InputError, shortened


class NotWrittenError(InputError):
    """A file cannot be written."""


def replace_text(path: Path, text: str, shorter: str = "") -> None:
    """Replace a file by an ASCII text; on a full disk overwrite it in place by `text`, or by `shorter` if that fits.

    Raises InputError if neither is possible.
    """
    try:
        with whole_file(path) as part:
            part.write_text(text)
    except InputError:
        size = path.stat().st_size if path.is_file() else 0
        fitting = next((option for option in (text, shorter) if 0 < len(option) <= size), None)
        if fitting is None:
            raise
        with path.open("r+") as file:
            file.write(fitting.ljust(size))


@contextmanager
def whole_file(path: Path, parents: bool = False) -> Iterator[Path]:
    """Yield a temporary path, which is renamed to `path` if the block succeeds and else removed.

    The temporary path contains the process id, so several processes may write the same file. parents: create the
    folder. Raises InputError if the file cannot be written.
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
            part.unlink(missing_ok=True)  # another process may remove the folder


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files of these names in a folder, texts as UTF-8, atomically, and return their paths; existing files are
    replaced. Raises InputError as `whole_file`."""
    for name, content in contents.items():
        with whole_file(folder / name, parents=True) as part:
            part.write_bytes(content if isinstance(content, bytes) else content.encode())
    return [folder / name for name in contents]


@contextmanager
def optional_cache() -> Iterator[None]:
    """Write to a cache in the block; if that fails, log a warning once and continue."""
    try:
        yield
    except (NotWrittenError, OSError, RuntimeError) as error:  # RuntimeError: h5py on a full disk
        warn_once(shortened(f"{' '.join(str(error).split())}; the run continues without the cache"))


@cache
def warn_once(message: str) -> None:
    """Log a warning unless it was logged before."""
    logging.getLogger(__name__).warning(message)
