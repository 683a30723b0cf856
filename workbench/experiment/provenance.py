"""Provenance of a run, from which it can be repeated: a hash of its configuration, code, command and inputs."""

import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from errno import ENAMETOOLONG
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import OURS, folder_of, packages
from workbench.motion.formats.names import SUFFIXES
from workbench.recording.settings import NO_EFFECT, leaves
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded
from workbench.utils.processes import CAPTURED, run
from workbench.utils.source_hash import digest_of, read_sources

_CODE = ("workbench", "conf")
"""Folders of the git clone that determine a run's numbers."""
MAX_DIFFERENCE = 100_000
"""Maximum length of a recorded difference, characters."""
CUT = "\n# cut off here: the difference is longer than the limit\n"

RECORDED = {"cmu": ("cmu",), "bandai": ("bandai",), "recorded": ("cmu", "bandai")}
"""Folders of paths.data by the value of `motions`."""

PYTHON = "python"
"""Name of the experiment for a run of components built in Python."""


@dataclass(frozen=True)
class Command:
    """The command of a run.

    overrides: arguments of the command line. choices: the chosen options, by group. python_call: source of the call
    from Python that no command can express. parent: id of the run that this run repeats with changes, else empty.
    """

    overrides: Sequence[str] = ()
    choices: Mapping[str, str] = field(default_factory=dict)
    parent: str = ""
    python_call: str = ""

    @property
    def line(self) -> str:
        """The shell command, or the call from Python."""
        return self.python_call or shlex.join(["workbench", "run", *self.overrides])


def provenance(config: DictConfig, command: Command) -> dict[str, Any]:
    """Return the provenance of a run as flat, non-empty values; unknown ones are omitted.

    commit, changed, difference: see `code_state`. lock: SHA-256 of requirements.lock. inputs: "name sha256" of every
    file, folder or database in the configuration. command, parent: see `Command`. choices:
    "group=option". Raises InputError for an input that cannot be read.
    """
    root = Path(__file__).parents[2]
    lock = root / "requirements.lock"
    groups = [group for group in command.choices if group != "if_chosen" and not group.startswith("hydra")]
    values: dict[str, Any] = {
        **code_state(root),
        "lock": hashlib.sha256(lock.read_bytes()).hexdigest() if lock.is_file() else "",
        "inputs": [f"{name} {digest}" for name, digest in sorted(input_files(config).items())],
        "command": command.line if command.overrides or command.choices else "",
        "choices": [f"{group}={command.choices[group]}" for group in groups],
        "parent": command.parent,
    }
    return {name: value for name, value in values.items() if value}


@cache
def code_state(root: Path) -> dict[str, str]:
    """Return the commit of the git clone at `root`, whether its code has changed, and the difference for `git apply`.

    The difference covers the folders _CODE, untracked files included, and ends with CUT after MAX_DIFFERENCE
    characters. Empty if `root` is no git clone or git is not installed.
    """
    top = _git(root, "rev-parse", "--show-toplevel")
    if not top or Path(top.strip()).resolve() != root.resolve() or not (commit := _git(root, "rev-parse", "HEAD")):
        return {}
    new = (_git(root, "ls-files", "--others", "--exclude-standard", "-z", "--", *_CODE) or "").split("\0")
    patches = [_git(root, "diff", "HEAD", "--", *_CODE)]
    patches += [_git(root, "diff", "--no-index", "--", "/dev/null", name) for name in new if name]
    difference = "".join(patch or "" for patch in patches)
    if len(difference) > MAX_DIFFERENCE:
        difference = difference[:MAX_DIFFERENCE] + CUT
    state = {"commit": commit.strip(), "changed": "yes" if difference else "no"}
    return state | ({"difference": difference} if difference else {})


def has_commit(root: Path, commit: str) -> bool:
    """Return whether the git clone at `root` has a commit."""
    return bool(_git(root, "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"))


def _git(root: Path, *arguments: str) -> str | None:
    """Return git's output; None if git is missing or fails. Exit code 1 of a difference is no failure."""
    command = ["git", "-C", str(root), *arguments]
    try:
        done = run(command, stdout=CAPTURED, stderr=CAPTURED, timeout_s=30.0)
    except OSError:
        return None
    return done.stdout.decode(errors="replace") if done.returncode in (0, 1) else None


def identity(config: DictConfig) -> str:
    """Return a SHA-256 of the resolved configuration, the sources of its components and the content of its input files.

    Locations do not count: paths.cache and paths.data are omitted, a file enters by name and content, a folder by the
    names and contents of its files. Recordings without a path (35_02, cmu) are looked up below paths.data; of a
    database all motion and index files count. Versions of other packages do not count; summary.json lists them. The
    recorder counts except for its viewer, as a reused run includes its recording. Raises InputError for a file that
    cannot be read.
    """
    inputs, chosen = _contents(config), _relevant(config)
    texts = tuple(map(str, chosen.values()))
    used = [name for name in packages() if name == OURS or any(text.startswith(f"{name}.") for text in texts)]
    settings = {
        place: [Path(value).name, inputs[value]] if isinstance(value, str) and value in inputs else value
        for place, value in chosen.items()
        if place != "recorder.stream"
    }
    content = {"config": settings, "code": [_code(package) for package in used]}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def input_files(config: DictConfig) -> dict[str, str]:
    """Return a SHA-256 of the file names and contents of every file, folder or database in the configuration.

    Raises InputError for a file that cannot be read.
    """
    return {name: hashlib.sha256(json.dumps(files).encode()).hexdigest() for name, files in _contents(config).items()}


def _relevant(config: DictConfig) -> dict[str, Any]:
    """Return the values that determine a run, by dotted key, without paths and nulls."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    ignored = (None, *(plain.get("paths") or {}).values())
    chosen = {key: value for key, value in plain.items() if key == "recorder" or key not in NO_EFFECT}
    return {place: value for place, value in leaves(chosen, lists=True) if value not in ignored}


def _contents(config: DictConfig) -> dict[str, list[tuple[str, str]]]:
    """Return for every text that names a file, folder or database its files with their SHA-256."""
    data = OmegaConf.select(config, "paths.data")
    folder = None if data is None else expanded(data)
    try:
        inputs = {
            name: sorted((below, _sha256(file, *_version(file))) for below, file in _files(name, folder).items())
            for name in _relevant(config).values()
            if isinstance(name, str)
        }
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from None
    return {name: files for name, files in inputs.items() if files}


def _files(name: str, data: Path | None) -> dict[str, Path]:
    """Return the files that a text in a configuration names, by relative name; empty for any other text."""
    library = name.rpartition(":")[0]
    path = expanded(library if library.endswith((".h5", ".hdf5")) else name)
    try:
        if path.is_file():
            return {path.name: path}
        if name and path.is_dir():
            return _below(path)
        return {} if data is None else _recorded(name, data)
    except OSError as error:
        if error.errno == ENAMETOOLONG:  # a text too long for a file name
            return {}
        raise


def _recorded(name: str, data: Path) -> dict[str, Path]:
    """Return the files of a database or clip that is named without a path."""
    from workbench.motion.sources import find_clip  # imported here, as it is slow

    if name in RECORDED:
        files = {f"{part}/{below}": file for part in RECORDED[name] for below, file in _below(data / part).items()}
        return {below: file for below, file in files.items() if file.suffix.lower() in (*SUFFIXES, ".asf", ".csv")}
    try:
        clip = find_clip(data, name)
    except InputError:
        return {}
    metadata = (*clip.parent.glob("*.asf"), *clip.parent.parent.glob("index.csv"))
    return {file.name: file for file in (clip, *metadata)}


def _below(folder: Path) -> dict[str, Path]:
    return {str(file.relative_to(folder)): file for file in folder.rglob("*") if file.is_file()}


def _version(file: Path) -> tuple[int, int]:
    """Return a file's size and modification time, which change when it is written."""
    status = file.stat()
    return status.st_size, status.st_mtime_ns


@lru_cache(maxsize=100_000)
def _sha256(file: Path, _size: int, _mtime_ns: int) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


@cache
def _code(package: str) -> str:
    sources = read_sources(folder_of(package))
    return digest_of(sources, sources)
