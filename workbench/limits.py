"""Bounds on what a stranger's file may hold, checked before anything of that size is made; see .docs/security.md."""

import json
import math
import os
import re
import resource
import stat
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from workbench.errors import InputError

if TYPE_CHECKING:  # the command line reads this module before it needs arrays
    from workbench.arrays import FloatArray

MOST_JOINTS = 1_000
"""Of a motion file's skeleton; detailed hands and faces have some hundred."""

MOST_FRAMES = 1_000_000
"""Of a clip: nine hours at 30 Hz."""

MOST_NUMBERS = 50_000_000
"""Of one array, whatever it is compressed to: 400 MB of float64."""

MOST_TEXT = 300_000_000
"""Bytes of a file that is read as text."""

MOST_CONFIG = 1_000_000
"""Characters of a configuration or a calibration; ours have some thousand."""

DEEPEST = 50
"""Levels of lists and mappings in one another."""

MOST_REFERENCES = 100
"""Of a configuration's value to its other values, and of theirs to others; and of a file in all."""

MOST_VALUES = 5_000
"""Of a configuration, keys included; ours have some hundred."""

MOST_DIGITS = 100
"""Of a number in a configuration."""

LARGEST_M = 1e7
"""Of a position, m: a quarter of the way around the earth."""

RATES_HZ = (0.1, 1e5)
"""The slowest and the fastest frames or samples, Hz."""

LONGEST_LIMB_M = 1.5
MOST_LEFT_MM = 200.0
"""Of the mean distance between a joint and where the retargeting has it."""

LARGEST_PX = 1e7
"""Of a place in an image."""

MOST_COUNT = 1_000_000
"""Of anything that a configuration counts: particles, frames, points, paths."""

MOST_ROUNDS = 1_000
"""Of what is done again and again for one frame."""

MOST_JOBS = 100_000
"""Of a sweep."""

MOST_PROCESSES = 1_000
"""Of a sweep, at once."""

MOST_WHOLE = 2**63 - 1
"""Of a seed."""

WIDEST_PX = 20_000
"""Of an image that is made."""

LARGEST = 1e9
"""Of any other number in a configuration, in whatever unit; sums of squares of such are still finite and exact."""

_MOST = {
    "seed": MOST_WHOLE, "width": WIDEST_PX, "height": WIDEST_PX,
    **dict.fromkeys(("layers", "steps", "moves", "guesses"), MOST_ROUNDS),
}  # fmt: skip
_LEAST = {"n_frames": 1, "n_particles": 1}
"""Of what a run has at least one of; other counts may be 0 somewhere."""
_MOST_BY_UNIT = {"_px": LARGEST_PX, "_m": LARGEST_M, "_hz": RATES_HZ[1]}

BYTES_A_PARTICLE = 4_000
"""What a filter takes at most for one of them: a few hundred numbers for its state, its pose and its joints."""

_LONG_NUMBER = re.compile(rf"[-+]?[0-9][0-9a-fA-FxXoObB_:.]{{{MOST_DIGITS},}}")
"""As YAML writes them, hexadecimal and sexagesimal ones, too, of which Python writes only some in decimal."""

_YAML = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def check_rate(place: object, rate_hz: float) -> float:
    """Return a rate in Hz within RATES_HZ; raises InputError, naming the place, for any other."""
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{place}: expected a rate of {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz, found {rate_hz:g}")
    return rate_hz


def check_places(place: object, positions: "FloatArray") -> None:
    """Raise InputError where a position (..., 3), m, lies farther out than LARGEST_M; NaN lies nowhere."""
    sizes = abs(positions)
    if (far := sizes > LARGEST_M).any():
        raise InputError(f"{place}: expected positions up to {LARGEST_M:g} m, found {sizes[far][0]:g} m")


def check_number(place: object, what: str, found: int, most: int) -> None:
    """Raise InputError, naming the place, where there are more than `most` of something."""
    if found > most:
        raise InputError(f"{place}: expected at most {most} {what}, found {found}")


def check_sizes(value: object, place: str = "") -> None:
    """Raise InputError for a number in a configuration that no run can have, before anything of its size is made; so
    are those that are no numbers and those without an end."""
    if isinstance(value, dict):
        for key, item in value.items():
            check_sizes(item, f"{place}.{key}" if place else str(key))
    elif isinstance(value, list):
        for item in value:
            check_sizes(item, place)
    elif isinstance(value, int | float) and not abs(value) <= (most := _most_of(place.rpartition(".")[2], value)):
        said = value if isinstance(value, float) or abs(value) < 2**64 else f"one of {value.bit_length()} bits"
        raise InputError(f"config: {place}: expected a number up to {most:.9g}, found {said}")
    elif isinstance(value, int | float) and value < (least := _LEAST.get(place.rpartition(".")[2], value)):
        raise InputError(f"config: {place}: expected at least {least}, found {value}")


def _most_of(name: str, value: float) -> float:
    """Tell how large a number may be, by the key that it is given to."""
    if name == "n_particles":
        return min(MOST_COUNT, memory_bytes() // (2 * BYTES_A_PARTICLE))
    if name in _MOST:
        return _MOST[name]
    if isinstance(value, int) and not name.startswith(("most_", "max_")):
        return MOST_COUNT
    return next((most for ending, most in _MOST_BY_UNIT.items() if name.endswith(ending)), LARGEST)


_PRODUCTS: Sequence[tuple[str, float]] = (
    ("dataset.n_frames dataset.width dataset.height", 1),
    ("dataset.width dataset.height", 200),
    ("dataset.n_points", 400),
    ("dataset.clutter", 400),
    ("dataset.n_frames", 2_000),
    ("inference.lag inference.n_particles", BYTES_A_PARTICLE),
    ("inference.n_paths inference.n_particles dataset.n_frames", BYTES_A_PARTICLE / 500),
    ("inference.n_paths dataset.n_frames", BYTES_A_PARTICLE),
    ("dataset.n_frames recorder.marginal_bins", 60 * 12),
    ("study.n_draws study.n_probes", BYTES_A_PARTICLE),
)
"""Keys whose numbers multiply in memory, and the bytes that one of the product takes."""


def check_products(config: Mapping[str, Any]) -> None:
    """Raise InputError where keys of a configuration, each within its own bound, come to more than half the memory."""
    half = memory_bytes() // 2
    for keys, bytes_each in _PRODUCTS:
        parts = [(config.get(group) or {}, key) for group, _, key in (text.partition(".") for text in keys.split())]
        found = [part.get(key) if isinstance(part, Mapping) else None for part, key in parts]
        numbers = [number for number in found if isinstance(number, int | float)]
        needed = math.prod((bytes_each, *numbers)) if len(numbers) == len(found) else 0
        if not needed <= half:
            said = ", ".join(f"{key}={number:.6g}" for key, number in zip(keys.split(), numbers, strict=True))
            raise InputError(
                f"config: {said}: about {needed / 1e9:.3g} GB together, expected at most {half / 1e9:.3g} GB"
            )


def memory_bytes() -> int:
    """How much memory this machine has."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def bounded_memory(more_bytes: int) -> Iterator[None]:
    """Let this process take no more than so much memory beyond what it has, where the system can be told so: libraries
    that believe a damaged file's lengths then raise instead of filling the machine's."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(statm.read_text().split()[0]) * resource.getpagesize() + more_bytes
    lowest = min(limit for limit in (taken, soft, hard) if limit != resource.RLIM_INFINITY)
    resource.setrlimit(resource.RLIMIT_AS, (lowest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def check_file(path: Path, most: int = MOST_TEXT) -> None:
    """Raise InputError for what is not an existing regular file of at most `most` bytes; a pipe would be waited for."""
    try:
        found = os.stat(path)
    except (OSError, ValueError) as error:
        said = "no such file" if isinstance(error, FileNotFoundError) else getattr(error, "strerror", None) or error
        raise InputError(f"{path}: {said}") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: expected a file, found {'a folder' if stat.S_ISDIR(found.st_mode) else 'none'}")
    check_number(path, "bytes", found.st_size, most)


def parse_json(place: object, text: str | bytes | bytearray) -> Any:
    """Parse JSON; raises InputError, naming the place, for anything else and for what is too deep."""
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        said = "levels without end" if isinstance(error, RecursionError) else error
        raise InputError(f"{place}: expected JSON, found {said}") from None


def parse_toml(place: object, text: str) -> dict[str, Any]:
    """Parse TOML; raises InputError, naming the place, for anything else, for what is too deep, and for longer keys
    of dotted names than DEEPEST, which take the square of their length."""
    check_number(place, "characters", len(text), MOST_CONFIG)
    if re.search(rf"""(?<![\w"'.-])(?:[\w"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}""", text):
        raise InputError(f"{place}: expected at most {DEEPEST} names in a dotted key, found more")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        said = "levels without end" if isinstance(error, RecursionError) else error
        raise InputError(f"{place}: expected TOML: {said}") from None


def check_yaml(place: object, text: str, most_values: int = MOST_VALUES) -> None:
    """Raise InputError for YAML that is too long or too deep, holds too many values, or refers to its own parts: a few
    lines of references to references stand for more than any memory holds."""
    check_number(place, "characters", len(text), MOST_CONFIG)
    check_number(place, "references ${…}", text.count("${"), MOST_REFERENCES)
    depth = n_values = 0
    try:
        for event in yaml.parse(text, _YAML):
            n_values += isinstance(event, yaml.NodeEvent)
            check_number(place, "keys and values", n_values, most_values)
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise InputError(f"{place}: expected at most {DEEPEST} levels in one another, found more")
            if isinstance(event, yaml.AliasEvent):
                raise InputError(f"{place}: expected YAML without references, found *{event.anchor}")
            if isinstance(event, yaml.ScalarEvent) and _LONG_NUMBER.fullmatch(event.value):
                raise InputError(f"{place}: expected numbers of at most {MOST_DIGITS} digits, found {event.value}")
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{place}: expected YAML: {' '.join(str(error).split())}") from None


def parse_yaml(place: object, text: str) -> Any:
    """Parse plain YAML, see `check_yaml`; raises InputError, naming the place, for anything else."""
    check_yaml(place, text)
    try:
        return yaml.load(text, _YAML)
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{place}: expected YAML: {' '.join(str(error).split())}") from None
