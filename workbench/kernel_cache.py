"""Where compiled kernels are kept between runs.

Numba keeps a compiled function as long as the file that it is written in stays the same. It holds the machine code of
whatever it calls, too, and the values of constants, so that an edit of these in another file would go unnoticed. So
kernels are kept in a folder named for everything that can have got into them.
"""

import hashlib
import os
import re
import shutil
from pathlib import Path

import numba

_IMPORTED = re.compile(rb"^from (workbench[\w.]*) import", re.MULTILINE)
_FOLDER = "kernels-"


def use_kernel_cache(package: Path) -> Path:
    """Have numba keep the kernels of a package, from now on, where `kernel_folder` says; the same folder."""
    folder = kernel_folder(package)
    if folder.parent == package / "__pycache__" and not folder.exists():
        for outdated in folder.parent.glob(f"{_FOLDER}*"):
            shutil.rmtree(outdated, ignore_errors=True)  # another process may be doing the same
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return folder


def kernel_folder(package: Path) -> Path:
    """The folder for the package as it is: in $NUMBA_CACHE_DIR, else with its byte code, else in ~/.cache."""
    own = package / "__pycache__" if os.access(package, os.W_OK) else Path("~/.cache/workbench").expanduser()
    return Path(os.environ.get("NUMBA_CACHE_DIR") or own) / f"{_FOLDER}{source_key(package)}"


def source_key(package: Path) -> str:
    """A hash of the sources that mention numba and of all that they import from the package, directly or not."""
    sources = {path.relative_to(package.parent): path.read_bytes() for path in package.rglob("*.py")}
    found: set[Path] = set()
    pending = {path for path, source in sources.items() if b"import numba" in source}
    while pending:
        found |= pending
        names = {name.decode() for path in pending for name in _IMPORTED.findall(sources[path])}
        pending = {path for path in sources if ".".join(path.with_suffix("").parts) in names} - found
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(path.as_posix().encode() + b"\0" + hashlib.sha256(sources[path]).digest())
    return digest.hexdigest()[:16]
