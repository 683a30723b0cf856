"""The program `workbench`: it imports the commands, during which SIGINT ends it at once."""

import gc

from workbench.utils.signals import ending_at_once


def main() -> int:
    """Run `workbench` with the command line's arguments and return its exit code, see `workbench.cli.main.main`.

    Python's cyclic garbage collection would take a sixth of a short run: imports create many objects and no garbage,
    and the last collection, at the exit, traverses all of them.
    """
    gc.set_threshold(10_000)  # new objects per collection
    with ending_at_once():
        from workbench.cli.main import main as run_command
    try:
        return run_command()
    finally:
        gc.freeze()
