"""Compiled kernels, cached on disk in one folder and recompiled when any source they depend on changes.

Numba's own cache notices edits of the file that a kernel is written in, but not of the functions and constants that it
takes from other files. Here the stamp of a cached kernel is a hash of its module and of everything that this imports
from the workbench, so an edit replaces the cached kernel.

Numba has no public way to choose the folder or the stamp for one kernel. This file therefore gives its own kernels
(no others) a cache of the class below; it was tested with numba 0.61 to 0.68.
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache

from workbench.utils.atomic_write import warn_once
from workbench.utils.source_hash import code_digest

_Function = TypeVar("_Function", bound=Callable[..., Any])
_PACKAGE = Path(__file__).parents[1]


def kernel(**options: Any) -> Callable[[_Function], _Function]:
    """Return a decorator that compiles a function with `numba.njit` and its options, without the interpreter's lock,
    and caches it."""

    def decorate(function: _Function) -> _Function:
        compiled: Any = numba.njit(nogil=True, **options)(function)
        compiled._cache = _KernelCache(function)  # type: ignore[no-untyped-call] # as `enable_caching()` does with a cache of numba's own kind
        return compiled

    return decorate


@cache
def _kernel_folder() -> Path:
    """Return the folder of cached kernels.

    Where the user set numba's own NUMBA_CACHE_DIR, below that; else with the package's byte code, or in ~/.cache where
    that is read-only.
    """
    if chosen := numba.config.CACHE_DIR:  # type: ignore[attr-defined]
        return Path(chosen) / "workbench"
    own = _PACKAGE / "__pycache__"
    writable = os.access(own if own.is_dir() else _PACKAGE, os.W_OK)
    return own / "kernels" if writable else Path("~/.cache/workbench/kernels").expanduser()


class _Locator:
    """The place of a cached kernel, and the hash of its sources, for numba."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._module, self._line = function.__module__, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], _file: str) -> "_Locator":
        return cls(function)

    def get_cache_path(self) -> str:
        return str(_kernel_folder() / self._module)

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)

    def get_source_stamp(self) -> str:
        return code_digest(sys.modules[self._module])

    def get_disambiguator(self) -> str:
        return str(self._line)


class _KernelFiles(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # type: ignore[list-item] # noqa: RUF012 (as numba declares it)


class _KernelCache(FunctionCache):
    """Numba's cache of a function. Where it cannot be used, as on a full disk, kernels stay in memory only."""

    _impl_class = _KernelFiles

    def load_overload(self, signature: Any, context: Any) -> Any:
        with _in_memory_only():
            return super().load_overload(signature, context)  # type: ignore[no-untyped-call]

    def save_overload(self, signature: Any, data: Any) -> None:
        with _in_memory_only():
            super().save_overload(signature, data)  # type: ignore[no-untyped-call]


@contextmanager
def _in_memory_only() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        warn_once(f"compiled kernels cannot be cached in {_kernel_folder()}: {error.strerror or error}")
