"""Keep compiled kernels between runs.

Numba keeps a compiled function as long as the file that it is written in stays the same. It holds the machine code of
whatever it calls, too, and the values of constants, so that an edit of these in another file would go unnoticed. So
kernels are kept in a folder named for everything that can have got into them.
"""

import logging
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from workbench.digest import digest_of, read_sources

_FOLDER = "kernels-"
_VARIABLE = "NUMBA_CACHE_DIR"
_in_use: Path | None = None


def use_kernel_cache(package: Path) -> Path:
    """Have numba keep the kernels of a package, from now on, where `kernel_folder` says; the same folder."""
    global _in_use
    _in_use = folder = kernel_folder(package)
    if folder.parent == package / "__pycache__" and not folder.exists():
        for outdated in folder.parent.glob(f"{_FOLDER}*"):
            shutil.rmtree(outdated, ignore_errors=True)  # another process may be doing the same
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    else:  # it reads this when it is imported, which takes long and which not every command needs
        os.environ[_VARIABLE] = str(folder)
    return folder


def is_kept(module: str, kernel: str) -> bool:
    """Tell whether the folder in use has a kernel of a module, by its full name, for whatever arguments."""
    *_, room, file = module.split(".")
    return _in_use is not None and any(_in_use.glob(f"{room}_*/{file}.{kernel}-*.nbi"))


def go_on_without_room() -> None:
    """Have numba keep kernels in memory only where their folder cannot take them, as on a full disk; told once."""
    from numba.core.caching import Cache

    @contextmanager
    def guard(cache: object) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            _tell_once(f"kernels are not kept, and compiled again by the next run: {error.strerror or error}")

    setattr(Cache, "_guard_against_spurious_io_errors", guard)  # noqa: B010 (numba's own does nothing but on Windows)


@cache
def _tell_once(sentence: str) -> None:
    logging.getLogger(__name__).warning(sentence)


def kernel_folder(package: Path) -> Path:
    """The folder for the package as it is, in `kept_folder`."""
    return kept_folder(package) / f"{_FOLDER}{source_key(package)}"


def kept_folder(package: Path) -> Path:
    """Where what follows from the package's sources is kept: $NUMBA_CACHE_DIR, else with its byte code, else in
    ~/.cache."""
    own = package / "__pycache__" if os.access(package, os.W_OK) else Path("~/.cache/workbench").expanduser()
    given = Path(os.environ.get(_VARIABLE) or own)
    return given.parent if given.name.startswith(_FOLDER) else given  # as the process that started this one set it


def source_key(package: Path) -> str:
    """Hash the sources that define kernels and all that they import from the package, directly or not."""
    sources = read_sources(package)
    return digest_of(sources, (name for name, source in sources.items() if b"njit" in source))[:16]
