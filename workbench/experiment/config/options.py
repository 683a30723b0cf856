"""The packages whose parts may be chosen and built, and what their folders `conf/` offer.

Nothing is imported here but the names: a part's module is read when the part is chosen, not before.
"""

import os
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from workbench.utils.errors import InputError

OURS = "workbench"
GROUPS = ("body", "dataset", "prior", "likelihood", "inference", "recorder", "study")
"""What a run is made of, in the order in which it is built."""

_ENTRY_POINTS = OURS + ".components"
"""Group of entry points by which an installed package says that it has parts; the value is the package's name."""

VARIABLE = "WORKBENCH_COMPONENTS"
"""Environment variable with names of packages, separated by commas."""

_TARGET = re.compile(r"""_target_["']?:\s*["']?([\w.]+)""")
_NOTE = re.compile(r"#   (\w+): (.+)")
_named: list[str] = []
_config_dirs: list[Path] = []


@dataclass(frozen=True)
class Option:
    """A file of a group. package: or folder given by --config-dir. text: its YAML."""

    package: str
    group: str
    name: str
    text: str

    @property
    def target(self) -> str | None:
        """The class or function that line 1 names."""
        found = _TARGET.match(self.text)
        return found[1] if found else None

    @property
    def about(self) -> str:
        """Return the first sentence of the comment that begins on line 2."""
        lines: list[str] = []
        for line in self.text.splitlines()[1:]:
            if not line.startswith("#") or _NOTE.fullmatch(line):
                break
            lines.append(line.lstrip("# "))
        return re.split(r"\.\s+(?=[A-Z])", " ".join(lines))[0].rstrip(".")

    @property
    def notes(self) -> dict[str, str]:
        """Return the notes on keys in its comments, by their names: `#   key: note`, or `key: value # note`."""
        found: dict[str, str] = {}
        for line in self.text.splitlines():
            if noted := _NOTE.fullmatch(line) or re.match(r"(\w+):.*? # (.+)", line):
                found[noted[1]] = noted[2]
        return found


def name_parts(packages: Iterable[str]) -> None:
    """Let this process import and build parts of these packages; raises InputError for one that is not found.

    Only what a person said may come here: words of a command line, never those of a file.
    """
    for package in packages:
        folder(package)
        if package not in _named:
            _named.append(package)


def parts_in(arguments: Sequence[str]) -> list[str]:
    """The packages that overrides `component_packages=[…]` among a command's arguments name.

    Raises InputError for anything but a list of names.
    """
    found = [text.partition("=")[2] for text in arguments if re.match(r"\+{0,2}component_packages=", text)]
    if not found:
        return []
    names = found[-1].strip("'\"").replace(" ", "")
    if not re.fullmatch(r"\[([\w.]+(,[\w.]+)*)?\]", names):
        raise InputError(
            f"component_packages: expected a list of packages, such as [my_components], found {found[-1]!r}"
        )
    return [name for name in names[1:-1].split(",") if name]


def name_config_dir(arguments: Sequence[str]) -> None:
    """Let this process choose the options in the folder given by `--config-dir` among a command's arguments."""
    found = [text.partition("=")[2] for text in arguments if text.startswith(("--config-dir=", "-cd="))]
    found += [folder for name, folder in pairwise(arguments) if name in ("--config-dir", "-cd")]
    _config_dirs[:] = [Path(each).absolute() for each in found]


def packages() -> tuple[str, ...]:
    """The workbench and every package named on the command line, in $WORKBENCH_COMPONENTS or by an entry point."""
    said = [name.strip() for name in os.environ.get(VARIABLE, "").split(",") if name.strip()]
    return tuple(dict.fromkeys((OURS, *_named, *said, *_installed())))


@cache
def _installed() -> tuple[str, ...]:
    return tuple(point.value for point in entry_points(group=_ENTRY_POINTS))


def is_allowed(target: str) -> bool:
    """Return whether a dotted name lies in one of the packages, by the name alone: nothing is imported."""
    return any(target.startswith(f"{package}.") for package in packages())


def how_to_allow(target: object) -> str:
    """What to say on the command line for a target of a package that nobody has named; empty where nothing helps."""
    package, _, name = str(target).partition(".")
    foreign = package.isidentifier() and name and package not in sys.stdlib_module_names
    return f"; if you trust it, say component_packages=[{package}]" if foreign and not is_allowed(f"{package}.") else ""


@cache
def folder_of(package: str) -> Path:
    """Find where a package lies; raises InputError for one that is not found. Nothing of it is run."""
    try:
        spec = find_spec(package)
    except ImportError:
        spec = None
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            f"component_packages: found no package {package!r}; install it, or put the folder it is in on PYTHONPATH"
        )
    return Path(spec.submodule_search_locations[0])


@cache
def folder(package: str) -> Path:
    """Find where its options lie, `conf/` of the package. Raises InputError where there is none."""
    if package == OURS:
        return Path(import_module(f"{OURS}.conf").__path__[0])
    found = folder_of(package) / "conf"
    if not found.is_dir():
        raise InputError(
            f"component_packages: expected options in {found}, such as {found / 'prior' / 'my_prior.yaml'}, found none"
        )
    return found


def folders() -> dict[str, Path]:
    """Return the folders with options by package, then the one given by --config-dir by its path."""
    return {package: folder(package) for package in packages()} | {str(path): path for path in _config_dirs}


def find(places: Iterable[Path], name: str) -> Path | None:
    """Return the file of an option in folders, such as prior/smooth.yaml; None where there is none.

    Raises InputError where two folders have files of this name that differ.
    """
    found = [path for place in places if (path := place / name).is_file()]
    if "/" in name and len({path.read_bytes() for path in found}) > 1:
        raise InputError(
            f"expected one {name}, found {' and '.join(map(str, found))}, which differ; rename one of them"
        )
    return found[0] if found else None


def options(group: str) -> dict[str, Option]:
    """Return the options of a group in all folders by name; raises InputError as `find`."""
    found, places = {}, folders()
    for package, place in places.items():
        for path in sorted((place / group).glob("[!_]*.yaml")):
            if find(places.values(), f"{group}/{path.name}") == path:
                found[path.stem] = Option(package, group, path.stem, path.read_text("utf-8", errors="replace"))
    return found


def targets() -> set[str]:
    """Return what the options of all packages build, parts within parts included: nothing else is ever called."""
    files = ((path, path.stat()) for each in packages() for path in folder(each).glob("**/*.yaml"))
    return {target for path, stat in files for target in _targets_of(path, stat.st_mtime_ns, stat.st_size)}


@lru_cache(maxsize=1024)
def _targets_of(path: Path, changed_ns: int, size: int) -> list[str]:
    """Find what a file that was last changed then names."""
    return _TARGET.findall(path.read_text(encoding="utf-8"))
