"""Turn the configuration stored in a recording into one that is safe to run here.

A recording may come from an untrusted source. Its configuration may build components that are options of the workbench
or of a package that the user has allowed, and read below the user's `paths.data`, or the folder INPUTS next to the
recording. It has only the keys of the schema, none of which names a place to write: the run writes to the user's cache
and to its own folder.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path, PureWindowsPath
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.instantiate import import_target, path_keys
from workbench.experiment.config.options import GROUPS, OURS, hint_to_allow, is_target
from workbench.experiment.config.schema import check_recorded, composed
from workbench.experiment.provenance import PYTHON
from workbench.recording.read.reader import Run
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError

INPUTS = "inputs"
"""Folder next to a recording with its files, which replaces paths.data where the recorded one has the same name."""


def current_defaults(overrides: Sequence[str]) -> DictConfig:
    """Return today's top level with the user's paths and today's tolerances; overrides of paths apply."""
    paths = [text for text in overrides if text.startswith("paths.")]
    return composed(["experiment=custom", *paths])


def runnable_config(
    run: Run, overrides: Sequence[str], current: DictConfig, components: Mapping[str, Any] | None = None
) -> DictConfig:
    """Return the stored configuration with the user's paths and the overrides.

    Paths below the stored paths.data or paths.cache move below the user's, or below INPUTS. n_threads gets its default;
    no viewer opens.

    Parameters
    ----------
    run : the recorded run.
    overrides : texts "key=value".
    current : today's defaults, see `current_defaults`.
    components : replacements of the recorded components by group, applied before the overrides.

    Raises
    ------
    InputError : with the recording and the key, for an interpolation, a target that is no option, an unknown key, a
        value of another type than its key's, an override of a missing key, or a path outside paths.data that is no
        override.
    """
    settings = run.settings
    if settings.get("experiment") == PYTHON:
        raise InputError(f"{run.path}: its components were built in Python; run that code again")
    _check_untrusted(run, settings)
    try:
        check_recorded(settings)
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    folders = {name: str(current.paths[name]) for name in ("data", "cache") if current.paths[name]}
    folders |= _own_inputs(run)
    moved = {**dict.fromkeys(GROUPS), "seed": 0, **_relocated(settings, settings.get("paths"), folders)}
    moved |= {"n_threads": None, "paths": {"data": folders.get("data"), "cache": folders.get("cache")}}
    if "stream" in (moved["recorder"] or {}):
        moved["recorder"]["stream"] = False
    moved.setdefault("check", OmegaConf.to_container(current.check))
    config = OmegaConf.create({**moved, **(components or {})})
    overridden = [_apply(run, config, text) for text in overrides]
    trusted = ("paths", *(components or {}), *overridden)
    for place, text in _outside(moved, folders.get("data")):
        if not f"{place}.".startswith(tuple(f"{key}{end}" for key in trusted for end in ".[")):
            raise InputError(f"{run.path}: {place}: {text!r} is outside paths.data; if you trust it, add {place}=…")
    return config


def _own_inputs(run: Run) -> dict[str, str]:
    """Return the folder INPUTS next to a recording that was made from one, as "data"; {} for a folder with links."""
    folder = run.path.parent / INPUTS
    recorded = str((run.settings.get("paths") or {}).get("data"))
    is_own = Path(recorded).name == INPUTS and folder.is_dir()
    return {"data": str(folder)} if is_own and not folder.is_symlink() and not any(_links(str(folder))) else {}


def _check_untrusted(run: Run, settings: Mapping[str, Any]) -> None:
    """Raise InputError for interpolations and for targets that are no options, without importing anything."""
    for place, value in leaves(settings, lists=True):
        if isinstance(value, str) and "${" in value:
            raise InputError(f"{run.path}: {place}: expected a resolved configuration, found {value!r}")
        special = [key for key in place.split(".") if key.startswith("_")]
        if special == ["_target_"] and not is_target(value) and str(value).startswith(f"{OURS}."):
            raise InputError(
                f"{run.path}: {place}: {value!r} is no component of the {OURS}; if an earlier version recorded it, "
                "compare it with another recording or repeat its experiment"
            )
        if special and (special != ["_target_"] or not is_target(value)):
            raise InputError(f"{run.path}: {place}: {value!r} is no component of the {OURS}{hint_to_allow(value)}")


def _relocated(value: Any, recorded: object, folders: Mapping[str, str]) -> Any:
    """Return the value with the user's folders in place of the recorded ones, as far as the user has set them."""
    if isinstance(value, Mapping):
        moved = {key: _relocated(item, recorded, folders) for key, item in value.items()}
        # the cache is the only folder that components write to
        return moved | ({"cache": folders["cache"]} if "cache" in moved else {})
    if isinstance(value, list):
        return [_relocated(item, recorded, folders) for item in value]
    for name, folder in folders.items():
        old = recorded.get(name) if isinstance(recorded, Mapping) else None
        if isinstance(value, str) and isinstance(old, str) and old and (value + "/").startswith(old.rstrip("/") + "/"):
            return folder + value[len(old.rstrip("/")) :]
    return value


def _apply(run: Run, config: DictConfig, text: str) -> str:
    """Apply an override key=value and return its key."""
    try:
        override = OverridesParser.create().parse_override(text)
    except (HydraException, RecursionError, ValueError) as error:
        raise InputError(f"{text[:60]}: expected key=value: {error}") from None
    key = override.key_or_group
    if override.is_add() or override.is_delete() or override.is_sweep_override():
        raise InputError(f"{text}: expected key=value with one value")
    parent, _, name = key.rpartition(".")
    node = OmegaConf.select(config, parent) if parent else config
    if not isinstance(node, DictConfig) or name not in node:
        raise InputError(f"{run.path}: {text}: its configuration has no key {key!r}")
    if isinstance(node[name], DictConfig) and not isinstance(override.value(), dict):
        raise InputError(
            f"{text}: {key} of a recording is a component; override its keys, such as {key}.KEY=VALUE, or choose "
            f"another component by workbench run from={run.path} {text}"
        )
    OmegaConf.update(config, key, override.value())
    return key


def _outside(node: Any, data: str | None, place: str = "", names_path: bool = False) -> Iterator[tuple[str, str]]:
    """Yield the places and texts of a configuration that could name a file outside the folder `data`.

    names_path: the texts are values of a key that names files or folders, see `path_keys`.
    """
    if isinstance(node, Mapping):
        paths = path_keys(import_target(node["_target_"])) if "_target_" in node else frozenset()
        for key, item in node.items():
            below, name = f"{place}.{key}" if place else str(key), str(key)
            is_path = bool(set(name) & set("./\\"))  # the keys of a mapping are read where a list is expected
            if _is_elsewhere(name) or (is_path and _is_outside(name, data, names_path=True)):
                yield below, name
            elif key == "data" and isinstance(item, str):  # the user may have linked databases below it
                yield from [(below, item)] if data is None or not _is_below(item, data) else []
            elif key not in ("_target_", "cache"):  # the cache is the user's
                yield from _outside(item, data, below, names_path or key in paths)
    elif isinstance(node, list):
        for k, item in enumerate(node):
            yield from _outside(item, data, f"{place}[{k}]", names_path)
    elif isinstance(node, str) and _is_outside(node, data, names_path):
        yield place, node


def _is_outside(text: str, data: str | None, names_path: bool) -> bool:
    """Return whether a text could name an existing file outside the folder `data`, perhaps by a symbolic link.

    A word without dots and slashes may have the name of a folder, unless its key names files and folders.
    """
    if _is_elsewhere(text):
        return True
    library = text.rpartition(":")[0]  # of LIBRARY.h5:clip
    paths = [os.path.expanduser(path) for path in (text or ".", *([library] if library else []))]
    is_word = not (names_path or set(text) & set("./\\"))
    exists = os.path.isfile if is_word else os.path.exists
    named = [path for path in paths if os.path.isabs(path) or exists(path)]
    return any(data is None or not all(_is_below(each, data) for each in (path, *_links(path))) for path in named)


def _is_elsewhere(text: str) -> bool:
    """Return whether a text is a path that leads upwards, one of another system, or an address."""
    windows = PureWindowsPath(text)
    of_windows = "\\" in text and bool(windows.root)
    return ".." in windows.parts or of_windows or "\0" in text or bool(re.search(r"\w:/", text))


def _is_below(path: str, folder: str) -> bool:
    """Return whether a path is the folder or below it after symbolic links are resolved."""
    root = os.path.realpath(os.path.expanduser(folder))
    return Path(os.path.realpath(os.path.expanduser(path))).is_relative_to(root)


def _links(folder: str) -> Iterator[str]:
    """Yield the symbolic links below a folder."""
    for place, *names in os.walk(folder):
        yield from filter(os.path.islink, (os.path.join(place, name) for name in chain(*names)))
