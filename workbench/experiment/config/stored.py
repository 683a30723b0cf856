"""From the configuration stored in a recording to one that is safe to run here.

A recording may come from a stranger. Its configuration may build components that the workbench, or a package that the
user has named, offers as options, read below the user's `paths.data`, and write to the cache and the run's folder.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import GROUPS, OURS, how_to_allow, targets
from workbench.experiment.config.schema import composed
from workbench.experiment.provenance import PYTHON
from workbench.recording.migrations import FORMAT, migrated
from workbench.recording.read.reader import Run
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError


def own_defaults(overrides: Sequence[str]) -> DictConfig:
    """Compose today's top level, with this person's paths and today's tolerances; overrides of paths are followed."""
    paths = [text for text in overrides if text.startswith("paths.")]
    return composed(["experiment=custom", *paths])


def runnable(run: Run, overrides: Sequence[str], own: DictConfig, parts: Mapping[str, Any] | None = None) -> DictConfig:
    """Return the stored configuration with our paths in place of its own, and with `overrides`, key=value.

    parts: what to put in place of its own by group, before the overrides.

    Every path that began with the stored paths.data or paths.cache begins with ours; threads are ours, and no viewer is
    called. Raises InputError, naming the recording and the key, for an interpolation, a target that is no option's, an
    override of a key that is not there, a removed key, or a path that leads out of paths.data and was not given as an
    override.
    """
    settings = run.settings
    if settings.get("experiment") == PYTHON:
        raise InputError(
            f"{run.path}: its parts were built in Python, which no configuration does: run that code again"
        )
    if run.format < FORMAT:
        settings = migrated(run.path, run.recorded_settings)
    _refuse_foreign(run, settings)
    ours = {name: str(own.paths[name]) for name in ("data", "cache") if own.paths[name]}
    moved = {**dict.fromkeys(GROUPS), "seed": 0, **_moved(settings, settings.get("paths"), ours), "threads": None}
    moved["paths"] = {"data": ours.get("data"), "cache": ours.get("cache")}
    if isinstance(moved["recorder"], dict):
        moved["recorder"]["stream"] = False
    moved.setdefault("check", OmegaConf.to_container(own.check))
    moved |= parts or {}
    config = OmegaConf.create(moved)
    given = [_apply(run, config, text) for text in overrides]
    for place, value in leaves(moved, lists=True):
        trusted = any(f"{place}.".startswith((f"{key}.", f"{key}[")) for key in ("paths", *given))
        if isinstance(value, str) and not trusted and _leads_out(value, ours.values()):
            raise InputError(f"{run.path}: {place}: {value!r} lies outside paths.data; if it is meant, say {place}=…")
    return config


def _refuse_foreign(run: Run, settings: Mapping[str, Any]) -> None:
    """Refuse by the words alone: nothing that a recording names is imported to find out what it is."""
    known = targets()
    for place, value in leaves(settings, lists=True):
        if isinstance(value, str) and "${" in value:
            raise InputError(f"{run.path}: {place}: expected a resolved configuration, found {value!r}")
        special = [key for key in place.split(".") if key.startswith("_")]
        if special == ["_target_"] and value not in known and str(value).startswith(f"{OURS}."):
            raise InputError(
                f"{run.path}: {place}: {value!r} is no part of the {OURS}; if an earlier version recorded it, compare "
                "it with another recording or run its experiment anew"
            )
        if special and (special != ["_target_"] or value not in known):
            raise InputError(f"{run.path}: {place}: {value!r} is no part of the {OURS}{how_to_allow(value)}")


def _moved(value: Any, theirs: object, ours: Mapping[str, str]) -> Any:
    """Put in our folders where texts begin with theirs; without paths.data of our own, theirs stays."""
    if isinstance(value, Mapping):
        moved = {key: _moved(item, theirs, ours) for key, item in value.items()}
        return moved | ({"cache": ours["cache"]} if "cache" in moved else {})  # the one folder that parts write to
    if isinstance(value, list):
        return [_moved(item, theirs, ours) for item in value]
    for name, folder in ours.items():
        old = theirs.get(name) if isinstance(theirs, Mapping) else None
        if isinstance(value, str) and isinstance(old, str) and old and (value + "/").startswith(old.rstrip("/") + "/"):
            return folder + value[len(old.rstrip("/")) :]
    return value


def _apply(run: Run, config: DictConfig, text: str) -> str:
    """Set the key that an override key=value names, and return it."""
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
            f"{text}: {key} of a recording has keys of its own, which can be changed, such as {key}.KEY=VALUE; another "
            f"part runs as workbench run from={run.path} {text}"
        )
    OmegaConf.update(config, key, override.value())
    return key


def _leads_out(text: str, allowed: Iterable[str]) -> bool:
    """Return whether a text could be a path or an address outside the allowed folders and the current one."""
    path, other = PurePosixPath(text), PureWindowsPath(text)
    if ".." in other.parts or "://" in text:
        return True
    absolute = path.is_absolute() or bool(other.root) or text.startswith("~")
    return absolute and not any(path.is_relative_to(folder) for folder in allowed)
