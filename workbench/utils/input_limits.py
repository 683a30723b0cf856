"""Bounds on what a file or a configuration may ask for, checked before arrays of that size are made."""

import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from workbench.utils.errors import InputError

if TYPE_CHECKING:  # the command line reads this module before it needs arrays
    from workbench.utils.arrays import FloatArray

MAX_JOINTS, MAX_FRAMES = 1_000, 1_000_000  # of a motion file
MAX_NUMBERS = 50_000_000  # of one array: 400 MB of float64
_MOST_TEXT, MAX_CONFIG = 300_000_000, 1_000_000  # bytes of a text file; characters of a configuration or a calibration
DEEPEST = 50  # levels of lists and mappings in one another
MAX_COUNT, LARGEST, _MOST_SEED = 1_000_000, 1e9, 2**63 - 1  # whole and other numbers of a configuration
MAX_JOBS = 100_000  # of a sweep

RATES_HZ = (0.1, 1e5)
LARGEST_M, LARGEST_PX = 1e7, 1e7  # of positions
LONGEST_LIMB_M = 1.5
MAX_RESIDUAL_MM = 200.0  # mean distance between a joint and its retargeted position

_MEMORY: Mapping[tuple[str, ...], int] = {
    ("dataset.n_frames", "dataset.width", "dataset.height"): 1,
    ("dataset.width", "dataset.height"): 200,
    ("inference.n_particles",): 4_000,
    ("inference.n_particles", "inference.lag"): 4_000,
    ("inference.n_paths", "dataset.n_frames"): 4_000,
}
"""Keys whose numbers multiply in memory, and bytes per unit of their product: pixels, and states of particles."""

_YAML = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LONG_NUMBER = re.compile(r"[-+]?[0-9][0-9a-fA-FxXoObB_:.]{100,}")
_LONG_KEY = re.compile(rf"""(?<![\w"'.-])(?:[\w"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}""")


def check_rate(place: object, rate_hz: float) -> float:
    """Return a rate in Hz within RATES_HZ; raises InputError, naming the place, for any other."""
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{place}: expected a rate of {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz, found {rate_hz:g}")
    return rate_hz


def check_places(place: object, positions: "FloatArray") -> None:
    """Raise InputError where a position (..., 3), m, is farther out than LARGEST_M; NaN is allowed."""
    sizes = abs(positions)
    if (far := sizes > LARGEST_M).any():
        raise InputError(f"{place}: expected positions up to {LARGEST_M:g} m, found {sizes[far][0]:g} m")


def check_number(place: object, what: str, found: int, most: int) -> None:
    """Raise InputError, naming the place, where there are more than `most` of something."""
    if found > most:
        raise InputError(f"{place}: expected at most {most} {what}, found {found}")


def check_sizes(value: object, place: str = "") -> None:
    """Raise InputError for a number in a configuration that is not finite or larger than any run needs."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else (("", item) for item in value):
            check_sizes(item, ".".join(filter(None, (place, str(key)))))
    elif isinstance(value, int | float):
        key = place.rpartition(".")[2]
        counts = isinstance(value, int) and not key.startswith(("most_", "max_"))
        most = _MOST_SEED if key == "seed" else MAX_COUNT if counts else LARGEST
        least = 1 if key in ("n_frames", "n_particles") else -most
        if not least <= value <= most:
            shown = "a longer one" if isinstance(value, int) and abs(value) >= 2**64 else value
            raise InputError(f"config: {place}: expected a number of {least:.9g} to {most:.9g}, found {shown}")


def check_products(config: Mapping[str, Any]) -> None:
    """Raise InputError where a configuration needs more than half of the memory, by the products of _MEMORY."""
    most_gb = _memory_bytes() / 2e9
    groups = {group: part for group, part in config.items() if isinstance(part, Mapping)}
    values = {f"{group}.{key}": value for group, part in groups.items() for key, value in part.items()}
    for keys, bytes_each in _MEMORY.items():
        numbers = {key: values[key] for key in keys if isinstance(values.get(key), int | float)}
        if len(numbers) == len(keys) and not (gb := math.prod(numbers.values()) * bytes_each / 1e9) <= most_gb:
            shown = ", ".join(f"{key}={number:.6g}" for key, number in numbers.items())
            raise InputError(f"config: {shown}: needs about {gb:.3g} GB, expected at most {most_gb:.3g} GB")


def _memory_bytes() -> int:
    """Return the memory of this machine in bytes."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def check_file(path: Path, most: int = _MOST_TEXT) -> None:
    """Raise InputError for anything but a regular file of at most `most` bytes; a pipe would block."""
    try:
        found = os.stat(path)
    except (OSError, ValueError) as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else getattr(error, "strerror", None) or error
        raise InputError(f"{path}: {reason}") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: expected a file, found {'a folder' if stat.S_ISDIR(found.st_mode) else 'none'}")
    check_number(path, "bytes", found.st_size, most)


def parse_json(place: object, text: str | bytes | bytearray) -> Any:
    """Parse JSON; raises InputError, naming the place, for anything else."""
    return _parsed(place, "JSON", json.loads, text)


def parse_toml(place: object, text: str) -> dict[str, Any]:
    """Parse TOML; raises InputError, naming the place, for anything else and for very long dotted keys."""
    check_number(place, "characters", len(text), MAX_CONFIG)
    if _LONG_KEY.search(text):  # the parser's time grows with the square of their length
        raise InputError(f"{place}: expected at most {DEEPEST} names in a dotted key, found more")
    return _parsed(place, "TOML", tomllib.loads, text)


def parse_yaml(place: object, text: str) -> Any:
    """Parse plain YAML without references; raises InputError, naming the place, for anything else."""
    check_number(place, "characters", len(text), MAX_CONFIG)
    return _parsed(place, "YAML", _load_yaml, text)


def _load_yaml(text: str) -> Any:
    """Load YAML whose events are harmless: deep levels crash the loader, and long numbers in base 60 take minutes."""
    depth = 0
    for event in yaml.parse(text, _YAML):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError(f"found references or more than {DEEPEST} levels in one another")
        if isinstance(event, yaml.ScalarEvent) and _LONG_NUMBER.fullmatch(event.value):
            raise ValueError("found a number of more than 100 digits")
    return yaml.load(text, _YAML)


def _parsed(place: object, kind: str, parse: Callable[[Any], Any], text: str | bytes | bytearray) -> Any:
    try:
        return parse(text)
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(f"{place}: expected {kind}: {' '.join(str(error).split())}") from None
