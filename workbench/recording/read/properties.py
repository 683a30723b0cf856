"""The types of a recording's properties and of its configuration, checked once, as a recording may be untrusted."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from workbench.utils.errors import InputError

Properties = dict[str, dict[str, Any]]

_GROUPS = ("body", "dataset", "prior", "likelihood", "inference", "recorder", "study")
_MAPPINGS = ("paths", "check", "training", "default_motions", "clips", "protocol", "sweep")
_MOST_WHOLE = 2**63 - 1
_Kind = tuple[str, Callable[[Any], bool]]
"""What is expected, in words, and whether a value is that."""


def _is_text(value: object) -> bool:
    return isinstance(value, str) and not any("\ud800" <= character <= "\udfff" for character in value)


def _is_number(value: object) -> bool:
    """Return whether a value is a float, or a whole number within 64 bits, and no truth."""
    return isinstance(value, float) or (type(value) is int and abs(value) <= _MOST_WHOLE)


def _is_whole(value: object) -> bool:
    return type(value) is int and 0 <= value <= _MOST_WHOLE


def _is_plain(value: object) -> bool:
    return _is_text(value) or _is_number(value) or isinstance(value, bool)


def _each(holds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return whether a value is that, or a list of values that each are."""
    return lambda value: all(map(holds, value if isinstance(value, list) else [value]))


_TEXT, _WORDS = ("a text", _is_text), ("a text or texts", _each(_is_text))
_TEXTS = ("texts", lambda value: isinstance(value, list) and all(map(_is_text, value)))
_WHOLE = ("a whole number", _is_whole)
_NUMBER, _NUMBERS = ("a number", _is_number), ("numbers", _each(_is_number))
_PLAIN = ("a text or a number, or several", _each(_is_plain))

_KINDS: Mapping[str, tuple[Mapping[str, _Kind], _Kind]] = {
    "run": ({"id": _TEXT, "status": _TEXT, "format": _WHOLE, "platform": _TEXT, "stopped": _TEXT}, _PLAIN),
    "environment": ({}, _TEXT),
    "config": ({"TextDocument:text": _TEXT}, _PLAIN),
    "provenance": (
        {"experiment": _TEXT, "seed": _WHOLE, "assumptions": _TEXT, "identity": _TEXT, "commit": _TEXT,
         "changed": _TEXT, "difference": _TEXT, "choices": _WORDS, "inputs": _WORDS, "parent_frame": _WHOLE},
        _PLAIN,
    ),
    "body": ({"joints": _TEXTS, "pose": _TEXTS}, _PLAIN),
    "shape": ({}, _NUMBERS),
    "metrics": ({}, _NUMBER),
    "cost": ({}, _NUMBER),
    "marginals": ({"names": _WORDS, "units": _WORDS, "low": _NUMBERS, "high": _NUMBERS, "frames": _NUMBERS}, _PLAIN),
}  # fmt: skip
"""By property the kinds of its keys, and the kind of all its other keys."""

_NEEDED = {"run": ("status",), "body": ("joints", "pose"), "marginals": ("names", "units", "low", "high", "frames")}


def checked(path: Path, found: Properties) -> Properties:
    """Return the properties of a recording; raises InputError for a key that is missing or of another kind."""
    for name, keys in found.items():
        known, others = _KINDS.get(name, ({}, None))
        for key, value in keys.items():
            words, holds = known.get(key, others or ("a text as its name", lambda _: True))
            if not _is_text(key) or not holds(value):
                raise InputError(f"{path}: property {name}.{key}: expected {words}, found {value!r}")
        if missing := [key for key in _NEEDED.get(name, ()) if key not in keys]:
            raise InputError(f"{path}: property {name}: expected its {missing[0]}, found none")
    return found


def check_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Raise InputError for a configuration with anything but texts, numbers, truths, lists and mappings by texts or
    whole numbers; and for components, paths and tolerances that are no mappings, and a seed that is no whole number."""
    _check_plain(path, settings, "configuration")
    for name in (*_GROUPS, *_MAPPINGS):
        if not isinstance(settings.get(name), dict | None):
            raise InputError(f"{path}: {name}: expected a mapping, found {settings[name]!r}")
    if not _is_whole(settings.get("seed", 0)):
        expected = "a configuration with a whole number as its seed"
        raise InputError(f"{path}: expected {expected}, found {settings['seed']!r}")


def _check_plain(path: Path, value: object, place: str) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            if not (_is_text(key) or _is_whole(key)):  # a camera's name may be a number
                raise InputError(f"{path}: {place}: expected texts or whole numbers as keys, found {key!r}")
            _check_plain(path, item, str(key))
    elif isinstance(value, list):
        for item in value:
            _check_plain(path, item, place)
    elif value is not None and not _is_plain(value):
        raise InputError(f"{path}: {place}: expected a text or a number, found {value!r}")
