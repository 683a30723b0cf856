"""What a run's numbers follow from, as one hash: its configuration, the code, and the files it reads."""

import hashlib
import json
from collections.abc import Set
from errno import ENAMETOOLONG
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import OURS, folder_of, packages
from workbench.motion.formats.names import SUFFIXES
from workbench.recording.settings import NO_EFFECT
from workbench.utils.errors import InputError
from workbench.utils.source_hash import digest_of, read_sources

RECORDED = {"cmu": ("cmu",), "bandai": ("bandai",), "recorded": ("cmu", "bandai")}
"""Folders of paths.data that a configuration's `motions` stand for."""


def identity(config: DictConfig) -> str:
    """A SHA-256 over the resolved configuration, the sources of what it builds and the content of the files it names.

    Where things are does not count: paths.cache and paths.data are left out, a file is its name and its content, a
    folder the names and contents below it. Recordings named without a path (35_02, cmu) are looked up below
    paths.data; of a whole database every motion file and index counts, read or not. Versions of other packages are not
    part of it; summary.json lists them. The recorder counts but for its viewer, as a run that is reused brings its
    recording along. Raises InputError for a file that cannot be read.
    """
    chosen, data, places = _told(config)
    chosen["recorder"] = {key: value for key, value in (chosen.get("recorder") or {}).items() if key != "live"}
    try:
        code = [_code(package) for package in packages() if package == OURS or f"'{package}." in str(chosen)]
        content = {"config": _by_content(chosen, data, {None, *places}), "code": code}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from None
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def input_files(config: DictConfig) -> dict[str, str]:
    """Name every file, folder or database that the configuration names, with a SHA-256 of its files' names and content.

    Raises InputError for a file that cannot be read.
    """
    chosen, data, places = _told(config)
    try:
        found = {name: _contents(name, data) for name in _texts(chosen, places)}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from None
    digests = {name: hashlib.sha256(json.dumps(files).encode()) for name, files in found.items() if files}
    return {name: digest.hexdigest() for name, digest in digests.items()}


def _told(config: DictConfig) -> tuple[dict[str, Any], Path | None, set[str | None]]:
    """What a configuration says of what comes out, the folder with recordings, and the texts that are only places."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    places = plain.get("paths") or {}
    data = None if places.get("data") is None else Path(places["data"]).expanduser()
    chosen = {key: value for key, value in plain.items() if key == "recorder" or key not in NO_EFFECT}
    return chosen, data, set(places.values())


def _texts(value: Any, places: Set[str | None]) -> set[str]:
    """Collect the texts in a configuration but for the places."""
    if isinstance(value, dict | list):
        return set().union(*(_texts(item, places) for item in (value.values() if isinstance(value, dict) else value)))
    return {value} if isinstance(value, str) and value not in places else set()


def _by_content(value: Any, data: Path | None, places: Set[str | None]) -> Any:
    """The value with every name of a file or folder replaced by what is in it; the places themselves are left out."""
    if isinstance(value, dict):
        return {
            str(key): _by_content(item, data, places)
            for key, item in value.items()
            if isinstance(item, dict | list) or item not in places
        }
    if isinstance(value, list):
        return [_by_content(item, data, places) for item in value]
    if isinstance(value, str) and (contents := _contents(value, data)):
        return [Path(value).name, contents]
    return value


def _contents(name: str, data: Path | None) -> list[tuple[str, str]]:
    """The files that a string names, each with its SHA-256; none for a string that names none."""
    return sorted((each, _sha256(file, *_version(file))) for each, file in _files(name, data).items())


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
    beside = (*clip.parent.glob("*.asf"), *clip.parent.parent.glob("index.csv"))
    return {file.name: file for file in (clip, *beside)}


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
