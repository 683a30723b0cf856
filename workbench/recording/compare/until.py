"""A test of paired differences that may be looked at after every pair and stopped whenever it is decided."""

from collections.abc import Sequence
from enum import Enum

import numpy as np

from workbench.arrays import FloatArray
from workbench.errors import InputError
from workbench.recording.compare.compare import Finding
from workbench.recording.compare.paired import differences, holm, pairs_of
from workbench.recording.read.reader import Run

_BETS = np.array([0.5, 1.0, 2.0, 4.0])
"""Stakes in units of the differences' size: small ones gain by many pairs that spread, large ones by a few alike."""


class Verdict(Enum):
    """What pairs tell of a number."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"
    OPEN = "open"


def evidence(pairs: FloatArray, centre: float = 0.0, side: int = 0) -> float:
    """The largest e-value so far against differences that are spread alike on both sides of `centre`.

    pairs: differences (n,), in the order in which they came. side: +1 or −1 where only a mean above or below `centre`
    is of interest, 0 for both. A bet on the sign of each xᵢ = dᵢ − centre, in which its size may be known, multiplies

        eᵢ = exp(c xᵢ/sᵢ) / cosh(c xᵢ/sᵢ) = 1 + tanh(c xᵢ/sᵢ),   sᵢ² = (x₁² + … + xᵢ²) / i,

    Fisher's e-test of symmetry (Vovk & Wang, Nonparametric e-tests of symmetry, New England Journal of Statistics in
    Data Science 2, 2024, section 4) with a stake per pair; products are averaged over the stakes c of _BETS and the
    sides. Whatever the distribution, the chance that this ever exceeds 1/α is at most α (Ville's inequality), so one
    may look after every pair. Code that did not change gives differences symmetric about 0, as old and new could be
    exchanged. One-sided, it is as good against every centre further off.
    """
    x = np.asarray(pairs, dtype=np.float64) - centre
    sizes = np.sqrt(np.cumsum(x**2) / np.arange(1, len(x) + 1))
    scaled = np.divide(x, sizes, out=np.zeros_like(x), where=sizes > 0.0)
    sides = np.array([-1.0, 1.0] if side == 0 else [float(side)])
    stakes = (sides[:, None] * _BETS).reshape(-1, 1)
    wealth = np.cumprod(1.0 + np.tanh(stakes * scaled), axis=1).mean(axis=0)
    return float(wealth.max(initial=1.0))


def confidence(d: FloatArray, level: float = 0.05) -> tuple[float, float]:
    """The centres that `evidence` of 1/level does not rule out: an interval valid at every look, on a grid of 1/200."""
    reach = 4.0 * float(np.ptp(d) + abs(d.mean()))
    centres = d.mean() + reach * np.linspace(-1.0, 1.0, 401)
    kept = [centre for centre in centres if evidence(d, centre) < 1.0 / level]
    return (float(kept[0]), float(kept[-1])) if kept else (float(d.mean()), float(d.mean()))


def decide(d: FloatArray, limit: float, level: float) -> Verdict:
    """Whether a number has changed, or has changed by less than `limit`; either is wrong at most at `level`."""
    if evidence(d) >= 1.0 / level:
        return Verdict.CHANGED
    if min(evidence(d, -limit, 1), evidence(d, limit, -1)) >= 1.0 / level:
        return Verdict.UNCHANGED
    return Verdict.OPEN


def p_values(numbers: Sequence[FloatArray]) -> FloatArray:
    """Probabilities for every number, valid at every look: the reciprocals of the evidence."""
    return np.array([min(1.0, 1.0 / evidence(each)) for each in numbers])


def judge(
    was: Sequence[Run], now: Sequence[Run], leading: str, limit: float, level: float
) -> tuple[Verdict, list[Finding]]:
    """What the pairs so far tell of all numbers of the runs.

    Half of `level` is for `leading`, see `decide`; the other half for all other numbers, by Holm's correction of their
    `p_values`, so that unchanged code is ever called changed, at whatever look, in at most `level` of cases. Unchanged
    is said of the leading number alone. A number that is missing from any run, or is not finite, counts as changed.
    """
    names = sorted({name for run in was for name in run.result})
    if leading not in names:
        raise InputError(f"{was[0].path}: has no number {leading}, of which --until is to decide")
    pairs = {name: pairs_of(name, was, now) for name in names}
    moved = {name: differences(*each) for name, each in pairs.items() if not isinstance(each, str)}
    others = [name for name in moved if name != leading]
    told = holm(p_values([moved[name] for name in others]), level / 2.0)
    refused = {name for name, yes in zip(others, told, strict=True) if yes}
    refused |= {name for name in names if name not in moved}
    verdict = decide(moved[leading], limit, level / 2.0) if leading in moved else Verdict.CHANGED
    findings = [_finding(name, pairs[name], name not in refused, "") for name in names if name != leading]
    sentence = f"{verdict.value} after {len(was)} pairs"
    findings.append(_finding(leading, pairs[leading], verdict is Verdict.UNCHANGED, sentence, f"± {limit:g}"))
    return (Verdict.CHANGED if refused else verdict), findings


def _finding(
    name: str, pairs: tuple[FloatArray, FloatArray] | str, passed: bool, words: str, allowed: str = "5 % at any look"
) -> Finding:
    if isinstance(pairs, str):
        return Finding(name, None, None, "", False, pairs)
    d = differences(*pairs)
    low, high = confidence(d)
    words = "; ".join(filter(None, (words, f"by {d.mean():+.3g}, in {low:+.3g} … {high:+.3g}")))
    return Finding(name, float(pairs[0].mean()), float(pairs[1].mean()), allowed, passed, words)
