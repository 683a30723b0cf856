"""What is shown while kernels compile, which takes the first run with a part some seconds and later ones none."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident
from typing import Any

from numba.core import event as events
from tqdm import tqdm

from workbench.clock import compiled_s

log = logging.getLogger(__name__)


class _Count(events.Listener):
    """n: kernels compiled so far, with the helpers that are compiled on their behalf as one, on whatever thread."""

    def __init__(self, bar: "tqdm[Any]") -> None:
        self.n, self._bar, self._depths = 0, bar, Counter[int]()

    def on_start(self, event: Any) -> None:
        """Called by numba when it begins to compile a function."""
        thread = get_ident()
        if self._depths[thread] == 0:
            self._bar.set_postfix_str(event.data["dispatcher"].py_func.__qualname__)
        self._depths[thread] += 1

    def on_end(self, event: Any) -> None:
        """Called by numba when it has compiled it; what was begun before anyone listened does not count."""
        thread = get_ident()
        if self._depths[thread] == 0:
            return
        self._depths[thread] -= 1
        if self._depths[thread] == 0:
            self.n += 1
            self._bar.update()


@contextmanager
def compiling(quiet: bool = False) -> Iterator[None]:
    """Show what is compiled in the block on a terminal, and say in the end how much it was.

    quiet: neither shown nor said. Nothing is said where all kernels are those of an earlier run.
    """
    what, before_s = "compiling, for later runs as well", compiled_s()
    with tqdm(desc=what, unit="kernel", disable=True if quiet else None, leave=False, delay=0.5) as bar:
        compiled = _Count(bar)
        with events.install_listener("numba:compile", compiled):
            yield
    if compiled.n and not quiet:
        log.info("compiled %d kernels in %.1f s; later runs find them", compiled.n, compiled_s() - before_s)
