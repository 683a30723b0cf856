"""Tolerances that are measured: by how much equal runs differ on other threads, libraries or machines."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from workbench.recording.compare.compare import Tolerance
from workbench.recording.compare.paired import LEVEL, differences, pairs_of
from workbench.recording.read.reader import Run


def measured(pairs: Sequence[tuple[Run, Run]]) -> dict[str, Tolerance]:
    """How far each number may move, from n ≥ 2 runs recorded and made again elsewhere: absolute, in its unit.

    Two-sided, of a difference d with mean 0, the interval in which the next one lies with the chance 1 − LEVEL / m:

        t(1 − LEVEL / (2 m); n) √(Σ dᵢ² / n) √(1 + 1/n),

    and at least the largest |dᵢ| seen, so that all m numbers of the next run pass in 95 % of cases. A number that never
    moved by more than rounding has 0. Numbers that some runs lack, or that are not finite, are left out.
    """
    was, now = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    names = sorted({name for run in was for name in run.result})
    found = {name: pairs_of(name, was, now) for name in names}
    moved = {name: differences(*each) for name, each in found.items() if not isinstance(each, str)}
    n, share = len(pairs), LEVEL / max(len(moved), 1)
    reach = float(scipy.stats.t.ppf(1.0 - share / 2.0, n)) * np.sqrt(1.0 + 1.0 / n)
    sizes = {name: max(reach * float(np.sqrt(np.mean(d**2))), float(np.abs(d).max())) for name, d in moved.items()}
    return {name: Tolerance(absolute=float(f"{size:.2g}")) for name, size in sizes.items()}


def as_yaml(tolerances: Mapping[str, Tolerance]) -> str:
    """As `check:` stands in a configuration; numbers that did not move share the first line."""
    still = [name for name, tolerance in tolerances.items() if tolerance.absolute == 0.0]
    lines = [f"check: # measured; exact: {', '.join(still) or 'none'}", "  default: {absolute: 0.0, relative: 1.0e-9}"]
    moved = {name: tolerance.absolute for name, tolerance in tolerances.items() if tolerance.absolute > 0.0}
    return "\n".join([*lines, *(f"  {name}: {{absolute: {size:g}, relative: 0.0}}" for name, size in moved.items())])
