"""What a recording's properties may be, once for all who read them: their types, and those of its configuration.

A recording may come from a stranger: whatever follows may take for granted what is here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.utils.errors import InputError
from workbench.utils.input_limits import DEEPEST

Properties = dict[str, dict[str, Any]]

GROUPS = ("body", "dataset", "prior", "likelihood", "inference", "recorder", "study")
MAPPINGS = ("paths", "check", "learn", "people", "clips", "protocol", "sweep")
MOST_WHOLE = 2**63 - 1


@dataclass(frozen=True)
class _Kind:
    """words: what is expected. holds: whether a value is that."""

    words: str
    holds: Callable[[Any], bool]


def _is_text(value: object) -> bool:
    return isinstance(value, str) and not any("\ud800" <= character <= "\udfff" for character in value)


def _is_number(value: object) -> bool:
    """A float of any size, or a whole number that others can hold; no truth."""
    return isinstance(value, float) or (isinstance(value, int) and type(value) is int and abs(value) <= MOST_WHOLE)


def _is_plain(value: object) -> bool:
    return _is_text(value) or _is_number(value) or isinstance(value, bool)


def _listed(value: object) -> list[Any]:
    return value if isinstance(value, list) else [value]


_TEXT = _Kind("a text", _is_text)
_TEXTS = _Kind("texts", lambda value: isinstance(value, list) and all(map(_is_text, value)))
_WORDS = _Kind("a text or texts", lambda value: _is_text(value) or _TEXTS.holds(value))
_WHOLE = _Kind("a whole number", lambda value: type(value) is int and 0 <= value <= MOST_WHOLE)
_NUMBER = _Kind("a number", _is_number)
_NUMBERS = _Kind("numbers", lambda value: all(map(_is_number, _listed(value))))
_PLAIN = _Kind("a text or a number, or several", lambda value: all(map(_is_plain, _listed(value))))

KINDS: Mapping[str, tuple[Mapping[str, _Kind], _Kind]] = {
    "run": ({"id": _TEXT, "status": _TEXT, "format": _WHOLE, "platform": _TEXT, "stopped": _TEXT}, _PLAIN),
    "environment": ({}, _TEXT),
    "config": ({"TextDocument:text": _TEXT}, _PLAIN),
    "provenance": (
        {"experiment": _TEXT, "seed": _WHOLE, "given": _TEXT, "identity": _TEXT, "commit": _TEXT, "changed": _TEXT,
         "difference": _TEXT, "choices": _WORDS, "inputs": _WORDS, "parent_frame": _WHOLE},
        _PLAIN,
    ),
    "body": ({"joints": _TEXTS, "pose": _TEXTS}, _PLAIN),
    "shape": ({}, _NUMBERS),
    "metrics": ({}, _NUMBER),
    "cost": ({}, _NUMBER),
    "marginals": ({"names": _WORDS, "units": _WORDS, "low": _NUMBERS, "high": _NUMBERS, "frames": _NUMBERS}, _PLAIN),
}  # fmt: skip
"""By property the kinds of its keys, and the kind of all its other keys."""

NEEDED = {"run": ("status",), "body": ("joints", "pose"), "marginals": ("names", "units", "low", "high", "frames")}


def checked(path: Path, found: Properties) -> Properties:
    """Return the properties of a recording; raises InputError for a key that is missing or of another kind."""
    for name, keys in found.items():
        known, others = KINDS.get(name, ({}, None))
        for key, value in keys.items():
            kind = known.get(key, others)
            if not _is_text(key) or (kind is not None and not kind.holds(value)):
                expected = "a text as its name" if kind is None else kind.words
                raise InputError(f"{path}: property {name}.{key}: expected {expected}, found {value!r}")
        if missing := [key for key in NEEDED.get(name, ()) if key not in keys]:
            raise InputError(f"{path}: property {name}: expected its {missing[0]}, found none")
    return found


def check_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Raise InputError for a configuration with anything but texts, numbers, truths, lists and mappings by texts;
    and for parts, paths and tolerances that are no mappings, and a seed that is no whole number."""
    _check_plain(path, settings, "configuration", 0)
    for name in (*GROUPS, *MAPPINGS):
        if not isinstance(settings.get(name), dict | None):
            raise InputError(f"{path}: {name}: expected a mapping, found {settings[name]!r}")
    if "seed" in settings and not _WHOLE.holds(settings["seed"]):
        raise InputError(
            f"{path}: expected a configuration with a whole number as its seed, found {settings['seed']!r}"
        )


def _check_plain(path: Path, value: object, place: str, depth: int) -> None:
    if depth > DEEPEST:
        raise InputError(f"{path}: expected at most {DEEPEST} levels in one another, found more")
    if isinstance(value, dict):
        for key, item in value.items():
            if not _is_text(key):
                raise InputError(f"{path}: {place}: expected texts as keys, found {key!r}")
            _check_plain(path, item, key, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _check_plain(path, item, place, depth + 1)
    elif value is not None and not _is_plain(value):
        raise InputError(f"{path}: {place}: expected a text or a number, found {value!r}")
