"""Turn the configuration stored in a recording into one that is safe to run here.

A recording may come from an untrusted source. Its configuration may build components that are options of the workbench
or of a package that the user has allowed, read below the user's `paths.data`, and write to the cache and the run's
folder.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import GROUPS, OURS, hint_to_allow, is_target
from workbench.experiment.config.schema import composed
from workbench.experiment.provenance import PYTHON
from workbench.recording.migrations import FORMAT, migrated
from workbench.recording.read.reader import Run
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError


def current_defaults(overrides: Sequence[str]) -> DictConfig:
    """Return today's top level with the user's paths and today's tolerances; overrides of paths apply."""
    paths = [text for text in overrides if text.startswith("paths.")]
    return composed(["experiment=custom", *paths])


def runnable_config(
    run: Run, overrides: Sequence[str], current: DictConfig, components: Mapping[str, Any] | None = None
) -> DictConfig:
    """Return the stored configuration with the user's paths and the overrides.

    Paths below the stored paths.data or paths.cache move below the user's. n_threads gets its default; no viewer opens.

    Parameters
    ----------
    run : the recorded run.
    overrides : texts "key=value".
    current : today's defaults, see `current_defaults`.
    components : replacements of the recorded components by group, applied before the overrides.

    Raises
    ------
    InputError : with the recording and the key, for an interpolation, a target that is no option, an override of a
        missing key, a removed key, or a path outside paths.data that is no override.
    """
    settings = run.settings
    if settings.get("experiment") == PYTHON:
        raise InputError(f"{run.path}: its components were built in Python; run that code again")
    if run.format < FORMAT:
        settings = migrated(run.path, run.recorded_settings)
    _check_untrusted(run, settings)
    folders = {name: str(current.paths[name]) for name in ("data", "cache") if current.paths[name]}
    moved = {
        **dict.fromkeys(GROUPS),
        "seed": 0,
        **_relocated(settings, settings.get("paths"), folders),
        "n_threads": None,
    }
    moved["paths"] = {"data": folders.get("data"), "cache": folders.get("cache")}
    if isinstance(moved["recorder"], dict):
        moved["recorder"]["stream"] = False
    moved.setdefault("check", OmegaConf.to_container(current.check))
    moved |= components or {}
    config = OmegaConf.create(moved)
    overridden = [_apply(run, config, text) for text in overrides]
    for place, value in leaves(moved, lists=True):
        trusted = any(f"{place}.".startswith((f"{key}.", f"{key}[")) for key in ("paths", *overridden))
        if isinstance(value, str) and not trusted and _is_outside(value, folders.values()):
            raise InputError(f"{run.path}: {place}: {value!r} is outside paths.data; if you trust it, add {place}=…")
    return config


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
        return moved | (
            {"cache": folders["cache"]} if "cache" in moved else {}
        )  # the only folder that components write to
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


def _is_outside(text: str, allowed: Iterable[str]) -> bool:
    """Return whether a text could be a path or address outside the allowed and the current folder."""
    path, other = PurePosixPath(text), PureWindowsPath(text)
    if ".." in other.parts or "://" in text:
        return True
    absolute = path.is_absolute() or bool(other.root) or text.startswith("~")
    return absolute and not any(path.is_relative_to(folder) for folder in allowed)
