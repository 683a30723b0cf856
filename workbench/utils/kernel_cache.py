"""Cache of compiled kernels on disk; a kernel is recompiled when any source that it depends on changes.

Numba's cache detects edits of a kernel's file, but not of functions and constants from other files. Here the stamp of a
cached kernel is a hash of its module and of all modules that this imports from the workbench.

Numba has no public interface for the folder and the stamp of one kernel. The kernels of the workbench (no others)
therefore use the cache class below, which works with numba 0.61 to 0.68.
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
from workbench.utils.signals import deferred
from workbench.utils.source_hash import code_digest

_Function = TypeVar("_Function", bound=Callable[..., Any])
_PACKAGE = Path(__file__).parents[1]


def kernel(**options: Any) -> Callable[[_Function], _Function]:
    """Return a decorator that compiles a function with `numba.njit`, without the GIL, and caches it on disk."""

    def decorate(function: _Function) -> _Function:
        compiled: Any = numba.njit(nogil=True, **options)(function)
        compiled._cache = _KernelCache(function)  # type: ignore[no-untyped-call] # as `enable_caching()` does
        return compiled

    return decorate


@cache
def _kernel_folder() -> Path:
    """Return the folder of cached kernels.

    It is below NUMBA_CACHE_DIR if that is set, else next to the package's byte code, or in ~/.cache if that is
    read-only.
    """
    if chosen := numba.config.CACHE_DIR:  # type: ignore[attr-defined]
        return Path(chosen) / "workbench"
    bytecode = _PACKAGE / "__pycache__"
    writable = os.access(bytecode if bytecode.is_dir() else _PACKAGE, os.W_OK)
    return bytecode / "kernels" if writable else Path("~/.cache/workbench/kernels").expanduser()


class _Locator:
    """Location and source hash of a cached kernel, for numba."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._module, self._line = function.__module__, function.__code__.co_firstlineno
        self._py_file = function.__code__.co_filename  # which numba names in a message

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
    """Numba's cache of a function. If it is unusable, as on a full disk, kernels stay in memory only."""

    _impl_class = _KernelFiles

    def load_overload(self, signature: Any, context: Any) -> Any:
        with deferred(), _in_memory_only():  # an interruption here would leave numba's tables of types incomplete
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
