"""Progress while kernels compile, which takes some seconds in the first run with a component."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from workbench.clock import compiled_s, measured_compilation

log = logging.getLogger(__name__)


@contextmanager
def compiling(quiet: bool = False) -> Iterator[None]:
    """Show on a terminal which kernels compile in the block, and log at its end how many did, unless `quiet`."""
    text, before_s, n = "compiling, for later runs as well", compiled_s(), 0
    with tqdm(desc=text, unit="kernel", disable=True if quiet else None, leave=False, delay=0.5) as bar:

        def ended() -> None:
            nonlocal n
            n += 1
            bar.update()

        with measured_compilation(bar.set_postfix_str, ended):
            yield
    if n and not quiet:
        log.info("compiled %d kernels in %.1f s; later runs find them", n, compiled_s() - before_s)
