"""Text for a terminal."""


def printable(words: str) -> str:
    """Return text in one line, with control characters, which untrusted recordings may contain, replaced by spaces."""
    return "".join(letter if letter.isprintable() else " " for letter in words)
