"""Tell whether what a cache holds was made by the code that asks for it."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

_IMPORT = re.compile(rb"^[ \t]*(?:from (workbench[\w.]*) import (\([^)]*\)|.*)|import (workbench[\w.]*))", re.MULTILINE)
_WORD = re.compile(rb"\w+")
_PACKAGE = Path(__file__).parent


def code_digest(*modules: ModuleType) -> str:
    """Hash the source of modules and of all that they import from the workbench, directly or not, by SHA-256.

    Without a module: of the whole workbench.
    """
    return _digest_of(frozenset(module.__name__ for module in modules))


def read_sources(package: Path) -> dict[str, bytes]:
    """Read the source of every module of a package, by its dotted name."""
    places = {path: path.relative_to(package.parent).with_suffix("") for path in package.rglob("*.py")}
    return {".".join(place.parts).removesuffix(".__init__"): path.read_bytes() for path, place in places.items()}


def digest_of(sources: Mapping[str, bytes], modules: Iterable[str]) -> str:
    """Hash the sources of modules and of all that they import, directly or not, by SHA-256."""
    found: set[str] = set()
    pending = set(modules)
    while pending:
        found |= pending
        if len(found) == len(sources):
            break
        pending = {name for module in pending for name in _imported(sources[module]) if name in sources} - found
    digest = hashlib.sha256()
    for module in sorted(found):
        digest.update(module.encode() + b"\0" + hashlib.sha256(sources[module]).digest())
    return digest.hexdigest()


@cache
def _digest_of(modules: frozenset[str]) -> str:
    return digest_of(_sources(), modules or _sources())


@cache
def _sources() -> dict[str, bytes]:
    return read_sources(_PACKAGE)


def _imported(source: bytes) -> set[str]:
    """Name the modules that a source takes names from, and what it takes, which may be modules too."""
    names = set()
    for module, taken, whole in _IMPORT.findall(source):
        parent = (module or whole).decode()
        names |= {parent, *(f"{parent}.{name.decode()}" for name in _WORD.findall(taken))}
    return names
