"""Command lines of the analyses."""

import argparse
import logging
import os
from collections.abc import Sequence
from pathlib import Path

from workbench.utils.errors import InputError


def parser(name: str, description: str | None, what: str) -> argparse.ArgumentParser:
    """Return the parser of `python -m NAME [NAME…] [--seeds N] [--runs FOLDER] [--data DATA]`; log its progress.

    what: kind of things that its names choose.
    """
    logging.basicConfig(format="%(message)s")
    logging.getLogger("analysis").setLevel(logging.INFO)
    parser = argparse.ArgumentParser(
        prog=f"python -m {name}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{what} or how their names begin; none: all")
    parser.add_argument("--seeds", type=int, metavar="N", help="number of seeds of every experiment")
    parser.add_argument(
        "--runs", type=Path, default=Path("recordings/runs"), metavar="FOLDER", help="of cached runs (recordings/runs)"
    )
    parser.add_argument("--data", default=os.environ.get("WORKBENCH_DATA"), help="recorded motion ($WORKBENCH_DATA)")
    return parser


def chosen(names: Sequence[str], every: Sequence[str]) -> list[str]:
    """Return those of all names that begin with one of `names`, or all; raises InputError for one that fits none."""
    for name in names:
        if not any(each.startswith(name) for each in every):
            raise InputError(f"{name}: expected a name or how it begins, of {', '.join(every)}")
    return [each for each in every if not names or each.startswith(tuple(names))]
