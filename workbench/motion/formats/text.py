"""Text parsing of motion files, with errors that name the file and the line."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_file

Statement = tuple[int, list[str]]
"""The number of a line, from 1, and its words."""


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file, with any line ending; raises InputError if it is missing or not text."""
    check_file(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected a text file, found bytes that are not UTF-8") from None
    return text.removesuffix("\n").split("\n")


def statements(lines: Sequence[str]) -> Iterator[Statement]:
    """Yield the number and the words of every line that is neither blank nor a comment (#)."""
    for line, text in enumerate(lines, 1):
        if (words := text.split()) and not words[0].startswith("#"):
            yield line, words


def fail(path: Path, line: int, message: str) -> NoReturn:
    """Raise an InputError for a line of a file, counted from 1."""
    raise InputError(f"{path}, line {line}: {message}")


def numbers(path: Path, line: int, words: Sequence[str], count: int, what: str) -> list[float]:
    """Return exactly `count` numbers for the quantity `what`; raises InputError, naming it, for anything else."""
    if len(words) != count:
        fail(path, line, f"expected {count} value{'s' * (count != 1)} for {what}, found {len(words)}")
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    # float() also accepts "nan", "inf" and "1_000", which are not numbers in a motion file; 1e12 exceeds any unit
    if len(values) != count or not all(abs(value) < 1e12 for value in values) or "_" in "".join(words):
        fail(path, line, f"expected numbers for {what}, found {' '.join(words)[:60]!r}")
    return values
