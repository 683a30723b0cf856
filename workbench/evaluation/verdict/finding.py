"""Findings on a run or a calibration, their levels, and the sentence they make together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

TRUSTWORTHY, DOUBTFUL, NOT_USABLE = "trustworthy", "doubtful", "not usable"
LEVELS = (TRUSTWORTHY, DOUBTFUL, NOT_USABLE)
"""Levels of a verdict, the best first."""
NOTE = ""
"""Level of a finding without a judgement."""
_MAX_REASONS = 3


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    kind: its subject, such as "height mismatch". message: a clause with numbers and units. level: TRUSTWORTHY where
    the value is as expected, DOUBTFUL, NOT_USABLE, or NOTE.
    """

    kind: str
    message: str
    level: str = DOUBTFUL

    @property
    def is_problem(self) -> bool:
        """Whether it lowers a verdict."""
        return self.level in (DOUBTFUL, NOT_USABLE)


def problems(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings that lower a verdict, the worst first, otherwise in their order."""
    return tuple(sorted((each for each in findings if each.is_problem), key=lambda each: each.level != NOT_USABLE))


def level_of(findings: Iterable[Finding]) -> str:
    """Return the worst level of findings."""
    return max((each.level for each in findings if each.is_problem), key=LEVELS.index, default=TRUSTWORTHY)


def conclusion(findings: Sequence[Finding]) -> str:
    """Return "trustworthy", "doubtful, because …" or "not usable, because …", with at most _MAX_REASONS reasons."""
    reasons = list(dict.fromkeys(each.message for each in problems(findings)))
    if not reasons:
        return TRUSTWORTHY
    rest = len(reasons) - _MAX_REASONS
    more = [f"and {rest} more reason{'s' if rest > 1 else ''}"] if rest > 0 else []
    return f"{level_of(findings)}, because {'; '.join([*reasons[:_MAX_REASONS], *more])}"
