"""Hashes of source code, which detect that a cache was written by other code."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

_IMPORT = re.compile(rb"^[ \t]*(?:from (workbench[\w.]*) import (\([^)]*\)|.*)|import (workbench[\w.]*))", re.MULTILINE)
_WORD = re.compile(rb"\w+")
_PACKAGE = Path(__file__).parents[1]


@cache
def code_digest(*modules: ModuleType) -> str:
    """Return the SHA-256 of the sources of modules and of their direct and indirect imports from the workbench."""
    sources = read_sources(_PACKAGE)
    files = {module.__name__: getattr(module, "__file__", None) for module in modules}
    others = {name: Path(file).read_bytes() if file else b"" for name, file in files.items() if name not in sources}
    return digest_of(sources | others, files)


@cache
def read_sources(package: Path) -> dict[str, bytes]:
    """Return the source of every module of a package, by dotted name."""
    places = {path: path.relative_to(package.parent).with_suffix("") for path in package.rglob("*.py")}
    return {".".join(place.parts).removesuffix(".__init__"): path.read_bytes() for path, place in places.items()}


def digest_of(sources: Mapping[str, bytes], modules: Iterable[str]) -> str:
    """Return the SHA-256 of the sources of modules and of their direct and indirect imports."""
    reached: set[str] = set()
    pending = set(modules)
    while pending:
        reached |= pending
        pending = {name for module in pending for name in _imports(sources, module)} - reached
    digest = hashlib.sha256()
    for module in sorted(reached):
        digest.update(module.encode() + b"\0" + hashlib.sha256(sources[module]).digest())
    return digest.hexdigest()


def _imports(sources: Mapping[str, bytes], module: str) -> set[str]:
    """Return the modules of `sources` that a module imports, including imported names that are modules."""
    names = set()
    for source, names_text, module_name in _IMPORT.findall(sources[module]):
        parent = (source or module_name).decode()
        names |= {parent, *(f"{parent}.{name.decode()}" for name in _WORD.findall(names_text))}
    return names & sources.keys()
