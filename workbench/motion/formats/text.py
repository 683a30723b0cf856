"""Text parsing of motion files, with errors that name the file and the line."""

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from workbench.utils import input_limits
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_number
from workbench.utils.text import read_text

log = logging.getLogger(__name__)

_GAPS = "nan -nan +nan nan(ind) -nan(ind) -1.#ind 1.#qnan -1.#qnan null none na n/a -"
MISSING = frozenset(["", *_GAPS.split(" ")])
"""Cells of a table, in lower case, that mean a value is missing."""
_LARGEST = 1e12  # exceeds any unit
_CHUNK, _LONGEST_CELL = 10_000, 100  # lines read at once, and characters of their cells in the mean
Statement = tuple[int, list[str]]
"""The number of a line, from 1, and its words."""


def read_lines(path: Path, max_bytes: int = input_limits.MAX_TEXT) -> list[str]:
    """Return the lines of a text file, at most MAX_LINES, see `read_text`."""
    text = read_text(path, max_bytes)
    check_number(path, "lines", text.count("\n"), input_limits.MAX_LINES)
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
    # float() also accepts "nan", "inf" and "1_000", which are not numbers in a motion file
    if len(values) != count or not all(abs(value) < _LARGEST for value in values) or "_" in "".join(words):
        fail(path, line, f"expected numbers for {what}, found {' '.join(words)[:60]!r}")
    return values


def number_rows(
    rows: Sequence[tuple[int, str]],
    width: int,
    delimiter: str | None,
    row: Callable[[int], list[float]],
    may_end: bool = False,
) -> FloatArray:
    """Return the numbers (F, width) of lines of a table, NaN for the words in MISSING.

    Parameters
    ----------
    rows : F lines, each with its number in the file.
    delimiter : of cells; None: blanks, which leave no place for missing cells. Unless it is a comma, there may be
        decimal commas.
    row : the numbers of the k-th line; called where the fast reader of many lines finds other content, for the errors.
    may_end : whether the last cells may be absent; they are missing.
    """
    values = np.empty((len(rows), width))
    for begin in range(0, len(rows), _CHUNK):
        texts = [text.rstrip() for _, text in rows[begin : begin + _CHUNK]]
        fast = _fast_rows(texts, width, delimiter, may_end)
        values[begin : begin + len(texts)] = [row(begin + k) for k in range(len(texts))] if fast is None else fast
    return values


def _fast_rows(texts: Sequence[str], width: int, delimiter: str | None, may_end: bool) -> FloatArray | None:
    """Return the numbers of lines by NumPy's reader; None for content that it does not read."""
    if max(map(len, texts)) > _LONGEST_CELL * width:
        return None
    if delimiter is not None:
        ends = [delimiter * (width - 1 - text.count(delimiter)) for text in texts] if may_end else [""] * len(texts)
        lines = "\n".join(map("".join, zip(texts, ends, strict=True)))
        texts = re.sub(f"(?<=[{delimiter}\n])(?=[{delimiter}\n]|$)", "nan", lines).split("\n")
    if delimiter != ",":
        texts = [text.replace(",", ".") for text in texts]
    try:
        values = np.loadtxt(texts, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    is_whole = values.shape == (len(texts), width) and (np.isnan(values) | (np.abs(values) < _LARGEST)).all()
    return values if is_whole else None


def points(words: Sequence[str]) -> list[str]:
    """Return the words with decimal points instead of decimal commas."""
    return [word.replace(",", ".") for word in words]


def gap_numbers(path: Path, line: int, words: Sequence[str], count: int, what: str) -> list[float]:
    """Return exactly `count` numbers, NaN for the words in MISSING; raises InputError for anything else."""
    if len(words) != count or MISSING.isdisjoint(map(str.lower, words)):
        return numbers(path, line, words, count, what)
    present = [word for word in words if word.lower() not in MISSING]
    measured = iter(numbers(path, line, present, len(present), what))
    return [np.nan if word.lower() in MISSING else next(measured) for word in words]


def report_count(path: Path, announced: int, present: int) -> None:
    """Log a warning where a file's header announces another number of frames than there are, all of which are read."""
    if announced != present:
        log.warning("%s: the header has %d frames, the file %d; read are all of them", path, announced, present)


def last_values(path: Path, values: FloatArray) -> FloatArray:
    """Return values (F, C) with NaN replaced by the column's last number, its first before it, or 0; logged."""
    missing = np.isnan(values)
    if not missing.any():
        return values
    log.warning(
        "%s: %d of %d frames lack values, which repeat the last ones", path, missing.any(axis=1).sum(), len(values)
    )
    rows = np.where(missing, -1, np.arange(len(values))[:, None])
    last = np.maximum.accumulate(rows, axis=0)
    first = np.argmax(~missing, axis=0)
    filled = np.take_along_axis(values, np.where(last < 0, first, last), axis=0)
    return np.where(np.isnan(filled), 0.0, filled)
