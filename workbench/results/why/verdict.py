"""Which change would have held the person, and how surely."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.results.why.changes import SAME, SAME_WHOLE, Change
from workbench.results.why.futures import Future


@dataclass(frozen=True)
class Verdict:
    """What a change came to. held: of n seeds. low, high: 95 % interval of the share that it holds (Wilson 1927).
    lasted: part of the frames until the person was lost, the mean. error: in the image, widths of a forearm, the mean
    over the frames that lasted."""

    change: Change
    held: int
    n: int
    low: float
    high: float
    lasted: float
    error: float


def verdict(futures: Sequence[Future]) -> Verdict:
    """Sum up the futures of one change."""
    held, n = sum(each.held for each in futures), len(futures)
    interval = scipy.stats.binomtest(held, n).proportion_ci(0.95, method="wilson")
    lasted = np.mean([len(each.frames) for each in futures])
    error = np.mean([np.nanmean(each.errors) for each in futures])
    return Verdict(futures[0].change, held, n, float(interval.low), float(interval.high), float(lasted), float(error))


def ranked(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Order changes: what holds more often comes first, and of what holds as often what errs less."""
    return sorted(verdicts, key=lambda each: (-each.held / each.n, each.error))


def sentence(verdicts: Sequence[Verdict]) -> str:
    """Say what ranked verdicts come to: the first change, and whether it holds more surely than another seed alone."""
    best = verdicts[0]
    same = [each for each in verdicts if each.change in (SAME, SAME_WHOLE) and each.change.whole == best.change.whole]
    alone = same[0] if same else next(each for each in verdicts if each.change == SAME)
    if best.change in (SAME, SAME_WHOLE) or best.held * alone.n <= alone.held * best.n:
        return f"chance, as far as can be told: another seed alone holds the person in {alone.held} of {alone.n}"
    counts = np.array([[best.held, best.n - best.held], [alone.held, alone.n - alone.held]])
    sure = scipy.stats.fisher_exact(counts, "greater").pvalue
    words = f"most likely: {best.change.name}, which holds in {best.held} of {best.n} where another seed alone holds in"
    return f"{words} {alone.held} of {alone.n} (p = {sure:.2g}, Fisher's exact test)"


def table(verdicts: Sequence[Verdict]) -> str:
    """Write verdicts as lines of text; those of whole runs, from the first frame on, are marked."""
    lines = ["   held          95 %  error/forearm  with"]
    for each in verdicts:
        mark, interval = "*" if each.change.whole else " ", f"{each.low:.0%} to {each.high:.0%}"
        held = f"{each.held} of {each.n}"
        lines.append(f"{held:>7}{interval:>14}{each.error:>15.2f}  {mark}{each.change.name}")
    marked = ["* from the first frame on"] if any(each.change.whole for each in verdicts) else []
    return "\n".join([*lines, *marked])
