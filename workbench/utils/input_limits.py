"""Bounds on files and configurations, checked before arrays of their size are allocated."""

import json
import os
import re
import stat
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import yaml

from workbench.utils.errors import InputError

if TYPE_CHECKING:  # the command line reads this module before it needs arrays
    from workbench.utils.arrays import FloatArray

MAX_JOINTS, MAX_FRAMES = 1_000, 1_000_000  # of a motion file
MAX_NUMBERS = 50_000_000  # of one array: 400 MB of float64
MAX_VALUES = 11_000_000  # of a skeleton's channels, each of which takes 165 bytes of memory
MAX_CONTAINERS, MAX_ITEMS = 5_000_000, 25_000_000  # lists and mappings in JSON, and their items: 100 bytes each
MAX_TEXT, MAX_LINES = 250_000_000, 20_000_000  # bytes and lines of a text file
MAX_CONFIG = 1_000_000  # characters of a configuration or a calibration
DEEPEST = 50  # levels of nested lists and mappings
MAX_COUNT, LARGEST, _MAX_SEED = 1_000_000, 1e9, 2**63 - 1  # integers and other numbers of a configuration
MAX_JOBS = 100_000  # of a sweep

RATES_HZ = (0.1, 1e5)
LARGEST_M, LARGEST_PX = 1e7, 1e7  # of positions
LONGEST_LIMB_M = 1.5
MAX_RESIDUAL_MM = 200.0  # mean distance between a joint and its retargeted position

_YAML = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LONG_NUMBER = re.compile(r"[-+]?[0-9][0-9a-fA-FxXoObB_:.]{100,}")
_LONG_KEY = re.compile(rf"""(?<![\w"'.-])(?:[\w"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}""")


def check_rate(place: object, rate_hz: float) -> float:
    """Return a rate, Hz, within RATES_HZ; InputError, with the place, for any other."""
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{place}: expected a rate of {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz, found {rate_hz:g}")
    return rate_hz


def check_places(place: object, positions: "FloatArray") -> None:
    """Raise InputError if a coordinate of positions (..., 3), m, exceeds LARGEST_M; NaN is allowed."""
    sizes = abs(positions)
    if (far := sizes > LARGEST_M).any():
        raise InputError(f"{place}: expected positions up to {LARGEST_M:g} m, found {sizes[far][0]:g} m")


def check_number(place: object, what: str, number: int, maximum: int) -> None:
    """Raise InputError, with the place, if there are more than `maximum` of `what`."""
    if number > maximum:
        raise InputError(f"{place}: expected at most {maximum} {what}, found {number}")


def check_sizes(value: object, place: str = "") -> None:
    """Raise InputError for a number in a configuration that is not finite or out of bounds."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else (("", item) for item in value):
            check_sizes(item, ".".join(filter(None, (place, str(key)))))
    elif isinstance(value, int | float):
        key = place.rpartition(".")[2]
        counts = isinstance(value, int) and not key.startswith(("most_", "max_"))
        upper = _MAX_SEED if key == "seed" else MAX_COUNT if counts else LARGEST
        lower = 1 if key in ("n_frames", "n_particles") else -upper
        if not lower <= value <= upper:
            text = "a longer one" if isinstance(value, int) and abs(value) >= 2**64 else value
            raise InputError(f"config: {place}: expected a number of {lower:.9g} to {upper:.9g}, found {text}")


def check_file(path: Path, max_bytes: int = MAX_TEXT) -> None:
    """Raise InputError for anything but a regular file of at most `max_bytes` bytes; a pipe would block."""
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else getattr(error, "strerror", None) or error
        raise InputError(f"{path}: {reason}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: expected a file, found {'a folder' if stat.S_ISDIR(status.st_mode) else 'none'}")
    check_number(path, "bytes", status.st_size, max_bytes)


def parse_json(place: object, text: str | bytes | bytearray) -> Any:
    """Return parsed JSON; InputError, with the place, for any other text and for too many values."""
    content = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    check_number(place, "lists and mappings", content.count(b"[") + content.count(b"{"), MAX_CONTAINERS)
    check_number(place, "values", content.count(b",") + 1, MAX_ITEMS)
    return _parsed(place, "JSON", json.loads, text)


def parse_toml(place: object, text: str) -> dict[str, Any]:
    """Return parsed TOML; InputError, with the place, for any other text and for very long dotted keys."""
    check_number(place, "characters", len(text), MAX_CONFIG)
    if _LONG_KEY.search(text):  # the parsing time is quadratic in their length
        raise InputError(f"{place}: expected at most {DEEPEST} names in a dotted key, found more")
    return _parsed(place, "TOML", tomllib.loads, text)


def parse_yaml(place: object, text: str) -> Any:
    """Return parsed plain YAML without references; InputError, with the place, for any other text."""
    check_number(place, "characters", len(text), MAX_CONFIG)
    return _parsed(place, "YAML", _load_yaml, text)


def parse_xml(place: object, text: str) -> ElementTree.Element:
    """Return the root of an XML text without entities; InputError, with the place, for any other text."""
    check_number(place, "characters", len(text), MAX_CONFIG)
    if "<!ENTITY" in text:
        raise InputError(f"{place}: expected XML without entities")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{place}: expected XML: {error}") from None


def _load_yaml(text: str) -> Any:
    """Load YAML without deep nesting, which crashes the loader, and long base-60 numbers, which take minutes."""
    depth = 0
    for event in yaml.parse(text, _YAML):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError(f"found references or more than {DEEPEST} nested levels")
        if isinstance(event, yaml.ScalarEvent) and _LONG_NUMBER.fullmatch(event.value):
            raise ValueError("found a number of more than 100 digits")
    return yaml.load(text, _YAML)


def _parsed(place: object, kind: str, parse: Callable[[Any], Any], text: str | bytes | bytearray) -> Any:
    try:
        return parse(text)
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(f"{place}: expected {kind}: {' '.join(str(error).split())}") from None
