"""Where a run comes from, so that it can be repeated: its configuration as one hash, code, command and inputs."""

import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from errno import ENAMETOOLONG
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from workbench.core.keys import kept
from workbench.experiment.config.instantiate import keys_of
from workbench.experiment.config.options import OURS, folder_of, packages
from workbench.motion.formats.names import SUFFIXES
from workbench.recording.settings import NO_EFFECT, leaves
from workbench.utils.errors import InputError
from workbench.utils.processes import CAPTURED, run
from workbench.utils.source_hash import digest_of, read_sources

_CODE = ("workbench", "conf")
"""Folders of the clone that a run's numbers depend on."""
MOST_CHANGED = 100_000
"""Characters of a difference that are kept."""
CUT = "\n# cut off here: the difference is longer than what is kept\n"

RECORDED = {"cmu": ("cmu",), "bandai": ("bandai",), "recorded": ("cmu", "bandai")}
"""Folders of paths.data that a configuration's `motions` stand for."""

PYTHON = "python"
"""In place of an experiment's name for a run of parts that were built in Python."""

_MOST = 100
"""Numbers of an array that are written out; of a longer one its SHA-256 is."""
_MISSING = object()


@dataclass(frozen=True)
class Command:
    """What was said on the command line.

    overrides: as they stand there. choices: the option chosen, by group. said: what was said in Python instead, where
    no command says it. parent: the recording that the run branched off, by its run's id; empty where it did not.
    parent_frame: the frame from which it goes on; None where it starts from the first.
    """

    overrides: Sequence[str] = ()
    choices: Mapping[str, str] = field(default_factory=dict)
    parent: str = ""
    parent_frame: int | None = None
    said: str = ""

    @property
    def line(self) -> str:
        """The command, which a shell takes, or what was said in Python."""
        return self.said or shlex.join(["workbench", "run", *self.overrides])


def provenance(config: DictConfig, command: Command) -> dict[str, Any]:
    """Return what a run comes from, as flat values that are never empty.

    commit, changed, difference: see `code_state`. lock: SHA-256 of requirements.lock. inputs: "name sha256" of every
    file, folder or database that the configuration names. command, parent, parent_frame: see `Command`. choices:
    "group=option". What is not known is left out. Raises InputError for an input that cannot be read.
    """
    root = Path(__file__).parents[2]
    lock = root / "requirements.lock"
    groups = [group for group in command.choices if group != "when" and not group.startswith("hydra")]
    found: dict[str, Any] = {
        **code_state(root),
        "lock": hashlib.sha256(lock.read_bytes()).hexdigest() if lock.is_file() else "",
        "inputs": [f"{name} {digest}" for name, digest in sorted(input_files(config).items())],
        "command": command.line if command.overrides or command.choices else "",
        "choices": [f"{group}={command.choices[group]}" for group in groups],
        "parent": command.parent,
    }
    found = {name: value for name, value in found.items() if value}
    return found | ({} if command.parent_frame is None else {"parent_frame": command.parent_frame})


@cache
def code_state(root: Path) -> dict[str, str]:
    """The commit of the clone at `root`, whether its code was changed, and the difference as `git apply` takes it.

    Of the folders _CODE, files that git does not know yet included; the difference ends with CUT after MOST_CHANGED
    characters. Empty where `root` is no clone of its own, as when the workbench was installed without one, or there is
    no git.
    """
    top = _git(root, "rev-parse", "--show-toplevel")
    if not top or Path(top.strip()).resolve() != root.resolve() or not (commit := _git(root, "rev-parse", "HEAD")):
        return {}
    new = (_git(root, "ls-files", "--others", "--exclude-standard", "-z", "--", *_CODE) or "").split("\0")
    parts = [_git(root, "diff", "HEAD", "--", *_CODE)]
    parts += [_git(root, "diff", "--no-index", "--", "/dev/null", name) for name in new if name]
    difference = "".join(part or "" for part in parts)
    if len(difference) > MOST_CHANGED:
        difference = difference[:MOST_CHANGED] + CUT
    state = {"commit": commit.strip(), "changed": "yes" if difference else "no"}
    return state | ({"difference": difference} if difference else {})


def has_commit(root: Path, commit: str) -> bool:
    """Whether the clone at `root` holds a commit."""
    return bool(_git(root, "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"))


def _git(root: Path, *arguments: str) -> str | None:
    """Return git's output; None where there is no git, or it refuses. A difference ends it with code 1."""
    command = ["git", "-C", str(root), *arguments]
    try:
        done = run(command, stdout=CAPTURED, stderr=CAPTURED, timeout_s=30.0)
    except OSError:
        return None
    return done.stdout.decode(errors="replace") if done.returncode in (0, 1) else None


def identity(config: DictConfig) -> str:
    """A SHA-256 over the resolved configuration, the sources of what it builds and the content of the files it names.

    Where things are does not count: paths.cache and paths.data are left out, a file is its name and its content, a
    folder the names and contents below it. Recordings named without a path (35_02, cmu) are looked up below
    paths.data; of a whole database every motion file and index counts, read or not. Versions of other packages are not
    part of it; summary.json lists them. The recorder counts but for its viewer, as a run that is reused brings its
    recording along. Raises InputError for a file that cannot be read.
    """
    inputs, chosen = _contents(config), _relevant(config)
    words = tuple(map(str, chosen.values()))
    named = [each for each in packages() if each == OURS or any(word.startswith(f"{each}.") for word in words)]
    settings = {
        place: [Path(value).name, inputs[value]] if isinstance(value, str) and value in inputs else value
        for place, value in chosen.items()
        if place != "recorder.stream"
    }
    content = {"config": settings, "code": [_code(package) for package in named]}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def input_files(config: DictConfig) -> dict[str, str]:
    """Name every file, folder or database that the configuration names, with a SHA-256 of its files' names and content.

    Raises InputError for a file that cannot be read.
    """
    return {name: hashlib.sha256(json.dumps(files).encode()).hexdigest() for name, files in _contents(config).items()}


def _relevant(config: DictConfig) -> dict[str, Any]:
    """Return the values that a run depends on by dotted key, without its paths and what is null."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    ignored = (None, *(plain.get("paths") or {}).values())
    chosen = {key: value for key, value in plain.items() if key == "recorder" or key not in NO_EFFECT}
    return {place: value for place, value in leaves(chosen, lists=True) if value not in ignored}


def _contents(config: DictConfig) -> dict[str, list[tuple[str, str]]]:
    """Return the files below every text that names any, each with its SHA-256."""
    data = OmegaConf.select(config, "paths.data")
    folder = None if data is None else Path(data).expanduser()
    try:
        found = {
            name: sorted((each, _sha256(file, *_version(file))) for each, file in _files(name, folder).items())
            for name in _relevant(config).values()
            if isinstance(name, str)
        }
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from None
    return {name: files for name, files in found.items() if files}


def _files(name: str, data: Path | None) -> dict[str, Path]:
    """The files that a string in a configuration names, by their names relative to it; none for any other string."""
    library = name.rpartition(":")[0]
    path = Path(library if library.endswith((".h5", ".hdf5")) else name).expanduser()
    try:
        if path.is_file():
            return {path.name: path}
        if name and path.is_dir():
            return _below(path)
        return {} if data is None else _recorded(name, data)
    except OSError as error:
        if error.errno == ENAMETOOLONG:  # a text that can be no file's name
            return {}
        raise


def _recorded(name: str, data: Path) -> dict[str, Path]:
    """Find the files of a database or a clip that is named without a path."""
    from workbench.motion.sources import find_clip  # here, as it takes long to import

    if name in RECORDED:
        found = {f"{part}/{below}": file for part in RECORDED[name] for below, file in _below(data / part).items()}
        return {below: file for below, file in found.items() if file.suffix.lower() in (*SUFFIXES, ".asf", ".csv")}
    try:
        clip = find_clip(data, name)
    except InputError:
        return {}
    described = (*clip.parent.glob("*.asf"), *clip.parent.parent.glob("index.csv"))
    return {file.name: file for file in (clip, *described)}


def _below(folder: Path) -> dict[str, Path]:
    return {str(file.relative_to(folder)): file for file in folder.rglob("*") if file.is_file()}


def _version(file: Path) -> tuple[int, int]:
    """Identify a file's version, which changes whenever it is written."""
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


def described(part: object) -> dict[str, Any]:
    """Return the class of a live object under `_target_`, and its keys with their values, nested objects likewise.

    A key whose value the object does not keep, see `core.keys`, is named in `not_kept`, so that nothing is recorded
    that is not known. Of what was learned there are its arrays, too, or what identifies them.
    """
    arguments, names, not_kept = kept(part), list(keys_of(type(part))), []
    if is_dataclass(part):
        names += [each.name for each in fields(part) if isinstance(getattr(part, each.name), np.ndarray)]
    found: dict[str, Any] = {"_target_": f"{type(part).__module__}.{type(part).__qualname__}"}
    for name in names:
        value = arguments.get(name, getattr(part, name, _MISSING))
        if value is _MISSING:
            not_kept.append(name)
        else:
            found[name] = _plain(value)
    return found | ({"not_kept": not_kept} if not_kept else {})


def _plain(value: Any) -> Any:
    """Return a value as YAML has it."""
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return value.tolist() if value.size <= _MOST else f"{'×'.join(map(str, value.shape))}, sha256 {digest}"
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(each) for each in value]
    return described(value)
