"""Text for a terminal, and comparison of names."""

import re
from collections.abc import Iterable


def printable(words: str) -> str:
    """Return text in one line, with control characters, which untrusted recordings may contain, replaced by spaces."""
    return "".join(letter if letter.isprintable() else " " for letter in words)


def natural_order(names: Iterable[str]) -> list[str]:
    """Return names in natural order: frame_9 before frame_10."""
    return sorted(
        names, key=lambda name: [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", name)]
    )


def plain_name(name: str) -> str:
    """Return the letters and digits of a name, in lower case."""
    return re.sub(r"[^a-z0-9]", "", name.lower())
