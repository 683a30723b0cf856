"""Text files, text for a terminal, and comparison of names."""

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_TEXT, check_file

_NUMBER, _WHOLE = re.compile(r"(\d+(?:\.\d+)?)"), re.compile(r"(\d+)")
_EXTENSION = re.compile(r"\.[A-Za-z]\w*$")


def read_text(path: Path, max_bytes: int = MAX_TEXT) -> str:
    """Return the text of a file, with lines that end in \\n.

    Text that is neither UTF-8 nor UTF-16 with a byte-order mark is read as Windows' cp1252. Raises InputError, with the
    file, if it is missing, unreadable, larger than max_bytes or not text.
    """
    check_file(path, max_bytes)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    is_utf_16 = content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    for encoding in ("utf-16",) if is_utf_16 else ("utf-8-sig", "cp1252"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text.replace("\r\n", "\n").replace("\r", "\n")
    raise InputError(f"{path}: expected a text file, found bytes that are not UTF-8")


def printable(words: str) -> str:
    """Return text in one line, with control characters, which untrusted recordings may contain, replaced by spaces."""
    return "".join(letter if letter.isprintable() else " " for letter in words)


def natural_order(names: Sequence[str]) -> list[tuple[str, float | None]]:
    """Return names of files in the order of their numbers, each with its last number, None without one.

    A decimal point is part of a number (12.5 is after 12.0625), unless numbers of different lengths end in 0, as those
    of versions do (1.10 is after 1.9).
    """
    stems = [_EXTENSION.sub("", name) for name in names]
    fractions = [fraction for stem in stems for fraction in re.findall(r"\d\.(\d+)", stem)]
    versions = len({len(fraction) for fraction in fractions}) > 1 and any(re.fullmatch(r"\d+0", f) for f in fractions)
    number = _WHOLE if versions else _NUMBER

    def key(stem: str) -> list[tuple[float, str]]:
        return [(float(part), "") if number.fullmatch(part) else (-1.0, part) for part in number.split(stem)]

    order = sorted(range(len(names)), key=lambda k: (key(stems[k]), names[k]))
    found = [number.findall(stem) for stem in stems]
    return [(names[k], float(found[k][-1]) if found[k] else None) for k in order]


def plain_name(name: str) -> str:
    """Return the letters and digits of a name, in lower case."""
    return re.sub(r"[^a-z0-9]", "", name.lower())
