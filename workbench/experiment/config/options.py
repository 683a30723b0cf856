"""Packages whose components may be chosen and built, and the options in their folders `conf/`.

Options are read as text. The module of a component is imported only when the component is chosen.
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
"""Groups of components of a run, in the order in which they are built."""

_ENTRY_POINTS = OURS + ".components"
"""Group of entry points by which an installed package registers; the value is the package's name."""

VARIABLE = "WORKBENCH_COMPONENTS"
"""Environment variable with package names, separated by commas."""

_TARGET = re.compile(r"""_target_["']?:\s*["']?([\w.]+)""")
_NOTE = re.compile(r"#   ([\w.]+(?:, [\w.]+)*): (.+)")
_COMMON_NOTES = {
    "data": "folder of recorded motions and videos; null: none",
    "cache": "folder for results that are computed once and used again",
    "n_frames": "number of frames",
    "rate_hz": "frames per second",
    "width": "width of the image",
    "height": "height of the image",
    "focal_px": "focal length of the camera",
    "distance_m": "distance from the camera to the person half-way through",
    "view_azimuth_deg": "viewing direction relative to the direction of motion; 90: side view",
    "n_points": "number of points in a frame",
    "base": "the other prior; its keys are set by base.KEY",
    "filter": "the particle filter; its keys are set by filter.KEY",
    "algorithm": "how particles are resampled, moved and weighted; its keys are set by algorithm.KEY",
    "n_particles": "number of particles; null: that of the filter",
    "penalty": "smoothness of a least-squares fit: standard deviations of the changes between frames at 14 Hz, "
    "e.g. {position: 0.013, angle: 0.11}; null: built in",
}
"""Notes on keys of several options."""
_allowed: list[str] = []
_config_dirs: list[Path] = []


@dataclass(frozen=True)
class Option:
    """One option of a group. package: its package, or the folder of --config-dir. text: its YAML."""

    package: str
    group: str
    name: str
    text: str

    @property
    def target(self) -> str | None:
        """Dotted name of the class or function on line 1; None if there is none."""
        match = _TARGET.match(self.text)
        return match[1] if match else None

    @property
    def about(self) -> str:
        """First sentence of the comment that begins on line 2."""
        lines: list[str] = []
        for line in self.text.splitlines()[1:]:
            if not line.startswith("#") or _NOTE.fullmatch(line):
                break
            lines.append(line.lstrip("# "))
        return re.split(r"\.\s+(?=[A-Z])", " ".join(lines))[0].rstrip(".")

    @property
    def notes(self) -> dict[str, str]:
        """Notes on keys, by key: `#   key: note`, continued by `#     `, or `key: value # note`; `a, b:` is for both
        keys, `a.b:` for a key of the component a."""
        notes: dict[str, str] = {}
        for line in re.sub(r"\n#     ", " ", self.text).splitlines():
            if match := _NOTE.fullmatch(line) or re.match(r"(\w+):.*? # (.+)", line):
                notes |= dict.fromkeys(match[1].split(", "), match[2])
        return notes

    @property
    def all_notes(self) -> dict[str, str]:
        """The notes, with those of keys of several options, and those of other options of the class."""
        others = [each.notes for each in options(self.group).values() if each.target == self.target]
        inherited = {key: note for notes in others for key, note in notes.items() if "." not in key}
        return _COMMON_NOTES | inherited | self.notes


def allow_packages(packages: Iterable[str]) -> None:
    """Allow this process to import and build components of these packages.

    The names must come from the command line or from Python code, never from a file.

    Raises
    ------
    InputError : a package that is not found or has no options.
    """
    for package in packages:
        folder(package)
        if package not in _allowed:
            _allowed.append(package)


def packages_in(arguments: Sequence[str]) -> list[str]:
    """Return the packages of the override `component_packages=[…]` among a command's arguments.

    Raises
    ------
    InputError : the value is not a list of package names.
    """
    values = [text.partition("=")[2] for text in arguments if re.match(r"\+{0,2}component_packages=", text)]
    if not values:
        return []
    names = values[-1].strip("'\"").replace(" ", "")
    if not re.fullmatch(r"\[([\w.]+(,[\w.]+)*)?\]", names):
        raise InputError(
            f"component_packages: expected a list of packages, such as [my_components], found {values[-1]!r}"
        )
    return [name for name in names[1:-1].split(",") if name]


def set_config_dirs(arguments: Sequence[str]) -> None:
    """Add the options in the folder of `--config-dir` among a command's arguments."""
    folders = [text.partition("=")[2] for text in arguments if text.startswith(("--config-dir=", "-cd="))]
    folders += [folder for name, folder in pairwise(arguments) if name in ("--config-dir", "-cd")]
    _config_dirs[:] = [Path(folder).absolute() for folder in folders]


def packages() -> tuple[str, ...]:
    """Return the workbench and the packages of the command line, $WORKBENCH_COMPONENTS and entry points."""
    from_environment = [name.strip() for name in os.environ.get(VARIABLE, "").split(",") if name.strip()]
    return tuple(dict.fromkeys((OURS, *_allowed, *from_environment, *_installed())))


@cache
def _installed() -> tuple[str, ...]:
    return tuple(point.value for point in entry_points(group=_ENTRY_POINTS))


def is_allowed(target: str) -> bool:
    """Return whether a dotted name lies in one of the packages; nothing is imported."""
    return any(target.startswith(f"{package}.") for package in packages())


def hint_to_allow(target: object) -> str:
    """Return how to allow a target's package, for an error message; empty if it cannot be allowed."""
    package, _, name = str(target).partition(".")
    foreign = package.isidentifier() and name and package not in sys.stdlib_module_names
    allowable = foreign and not is_allowed(f"{package}.")
    return f"; if you trust its package, add component_packages=[{package}]" if allowable else ""


@cache
def folder_of(package: str) -> Path:
    """Return the folder of a package without running its code; InputError if it is not found."""
    try:
        spec = find_spec(package)
    except ImportError:
        spec = None
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            f"component_packages: found no package {package!r}; install it, or add its parent folder to PYTHONPATH"
        )
    return Path(spec.submodule_search_locations[0])


@cache
def folder(package: str) -> Path:
    """Return the folder `conf/` of a package; InputError if there is none."""
    if package == OURS:
        return Path(import_module(f"{OURS}.conf").__path__[0])
    conf = folder_of(package) / "conf"
    if not conf.is_dir():
        raise InputError(
            f"component_packages: expected options in {conf}, such as {conf / 'prior' / 'my_prior.yaml'}, found none"
        )
    return conf


def folders() -> dict[str, Path]:
    """Return the folders with options: those of packages by name, then those of --config-dir by path."""
    return {package: folder(package) for package in packages()} | {str(path): path for path in _config_dirs}


def find(places: Iterable[Path], name: str) -> Path | None:
    """Return the file of an option, such as prior/smooth.yaml, in the folders; None if there is none.

    Raises
    ------
    InputError : two folders have different files of this name.
    """
    files = [path for place in places if (path := place / name).is_file()]
    if "/" in name and len({path.read_bytes() for path in files}) > 1:
        raise InputError(f"{name}: expected one file, found {' and '.join(map(str, files))}; rename one of them")
    return files[0] if files else None


def options(group: str) -> dict[str, Option]:
    """Return the options of a group in all folders, by name; InputError as `find`."""
    chosen, places = {}, folders()
    for package, place in places.items():
        for path in sorted((place / group).glob("[!_]*.yaml")):
            if find(places.values(), f"{group}/{path.name}") == path:
                chosen[path.stem] = Option(package, group, path.stem, path.read_text("utf-8", errors="replace"))
    return chosen


def is_target(name: object) -> bool:
    """Return whether an option of the packages has this target, perhaps nested; no other target is ever called."""
    if name not in (targets := _targets(packages())):
        _targets.cache_clear()  # the option's file may be new
        targets = _targets(packages())
    return name in targets


@lru_cache(maxsize=8)
def _targets(packages: tuple[str, ...]) -> list[str]:
    files = (path for package in packages for path in folder(package).glob("**/*.yaml"))
    return sorted({target for path in files for target in _TARGET.findall(path.read_text(encoding="utf-8"))})
