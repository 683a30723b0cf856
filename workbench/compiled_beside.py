"""Kernels that another process compiles while this one gets ready what they are for.

Numba compiles on one core, whatever threads there are. So what takes longest to compile is begun as soon as a run is
known to need it, by a process that keeps it where this one looks for it. Whoever calls such a kernel before it is there
waits for it; where the other process fails it is compiled here, as without.
"""

import atexit
import gc
import logging
import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from subprocess import DEVNULL, Popen, TimeoutExpired
from time import sleep
from types import SimpleNamespace
from typing import Any

from workbench.kernel_cache import is_kept

log = logging.getLogger(__name__)

_LOOK_S, _END_S = 0.02, 1.0
_beside: dict[str, Popen[bytes]] = {}
"""By the full name of a kernel: the process that compiles it."""


def compile_beside(module: str, *kernels: str, by: str | None = None) -> None:
    """Have another process compile kernels of a module, where one of them is not kept; it ends at the latest with this.

    module: its full name, of this package. by: the module whose `compile_ahead` has them compiled, if it is another.
    """
    names = [f"{module}.{kernel}" for kernel in kernels]
    if not any(name in _beside for name in names) and not all(is_kept(module, kernel) for kernel in kernels):
        command = [sys.executable, "-P", "-m", __name__, by or module]
        _beside.update(dict.fromkeys(names, Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL)))


@cache
def wait_for_kernels() -> None:
    """Have numba wait, from now on, for what another process compiles; it counts as compiling, and is shown as such."""
    from numba.core import event
    from numba.core.caching import Cache

    load_overload: Any = Cache.load_overload

    def load(cache: Any, signature: Any, context: Any) -> Any:
        found, function = load_overload(cache, signature, context), cache._py_func
        process = _beside.get(name := f"{function.__module__}.{function.__qualname__}")
        if found is not None or process is None:
            return found
        with event.trigger_event("numba:compile", data={"dispatcher": SimpleNamespace(py_func=function)}):
            while found is None and name in _beside:
                sleep(_LOOK_S)
                if process.poll() is not None:
                    del _beside[name]
                found = load_overload(cache, signature, context)  # it may be the last thing that it left
        if found is None and process.returncode:
            log.warning("%s is compiled here: the process that was to do so ended with %d", name, process.returncode)
        return found

    setattr(Cache, "load_overload", load)  # noqa: B010 (numba has no other way to be told)


@atexit.register
def _end_all() -> None:
    for process in _beside.values():
        process.kill()
        with suppress(TimeoutExpired):  # what was raised while it was looked at may have left it locked
            process.wait(_END_S)


def main(module: str) -> None:
    """The other process: have a module's kernels compiled, and wait for what it has others compile."""
    gc.disable()  # saves a tenth: what compiling makes stays to the end
    wait_for_kernels()
    import_module(module).compile_ahead()


if __name__ == "__main__":
    from workbench import compiled_beside  # as kernels import it: this copy of it knows of none that they begin

    compiled_beside.main(sys.argv[1])
