"""From the configuration stored in a recording to one that is safe to run here, and its runs.

A recording may come from a stranger. What its configuration may do is build parts that the workbench, or a package that
whoever runs it has named, offers as options, read below that person's `paths.data`, and write to their cache and to the
folder that the run is given.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import count, islice
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from workbench.errors import InputError
from workbench.experiment.composition import composed
from workbench.experiment.described import PYTHON
from workbench.experiment.execute import execute
from workbench.experiment.older import in_todays_words
from workbench.experiment.parts import GROUPS, OURS, how_to_allow, targets
from workbench.limits import parse_json
from workbench.recording.compare.agreement import Agreement, Tolerance
from workbench.recording.compare.compare import Finding
from workbench.recording.read.reader import Run, read
from workbench.recording.settings import NO_EFFECT, leaves
from workbench.run_files import RECORDING

TOLERANCES = "tolerances.json"
"""Next to recordings that are checked: by how much their numbers may move in another environment."""


def own_defaults(overrides: Sequence[str]) -> DictConfig:
    """Compose today's top level, with this person's paths and today's tolerances; overrides of paths are followed."""
    paths = [text for text in overrides if text.startswith("paths.")]
    return composed(["experiment=custom", *paths])


def runnable(run: Run, overrides: Sequence[str], own: DictConfig, parts: Mapping[str, Any] | None = None) -> DictConfig:
    """Return the stored configuration with our paths in place of its own, and with `overrides`, key=value.

    parts: what to put in place of its own by group, before the overrides.

    Every path that began with the stored paths.data or paths.cache begins with ours. Threads are ours too, since
    results do not depend on them, and no viewer is called. Words of earlier versions become today's. Raises InputError,
    naming the recording and the key, for an interpolation, a target that is no option's, an override of a key that is
    not there, another device than the CPU, or a path that leads out of paths.data and was not given as an override.
    """
    settings = run.settings
    if settings.get("experiment") == PYTHON:
        raise InputError(
            f"{run.path}: its parts were built in Python, which no configuration does: run that code again"
        )
    _refuse_foreign(run, settings)
    settings = in_todays_words(run.path, settings)
    ours = {name: str(own.paths[name]) for name in ("data", "cache") if own.paths[name]}
    moved = {**dict.fromkeys(GROUPS), "seed": 0, **_moved(settings, settings.get("paths"), ours), "threads": None}
    moved["paths"] = {"data": ours.get("data"), "cache": ours.get("cache")}
    if isinstance(moved["recorder"], dict):
        moved["recorder"]["live"] = False
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


def tolerances(run: Run, own: DictConfig) -> dict[str, Tolerance]:
    """Return by how much a run's numbers may move in another environment.

    Measured ones from `tolerances.json` next to the recording, see `measured_tolerances`; of other numbers those in the
    recorded configuration, or today's where it has none. Raises InputError for what is no tolerance.
    """
    today: Any = OmegaConf.to_container(own.check)
    stored = run.settings.get("check", today)
    try:
        usual = {name: Tolerance(**{key: float(value) for key, value in keys.items()}) for name, keys in stored.items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError(f"{run.path}: check: expected absolute and relative for every metric, found others") from None
    return usual | measured_tolerances(run.path)


def measured_tolerances(recording: Path) -> dict[str, Tolerance]:
    """Read those of a recording that `python -m analysis.tolerances` measured; empty where it has not."""
    path = recording.parent / TOLERANCES
    if not path.is_file():
        return {}
    measured = parse_json(path, path.read_text(encoding="utf-8"))
    try:
        numbers = measured["tolerances"].get(recording.stem, {})
        return {str(name): Tolerance(absolute=float(value)) for name, value in numbers.items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(f"{path}: expected numbers by recording and metric under 'tolerances'") from None


def again(was: Run, config: DictConfig, folder: Path) -> Run | Finding:
    """Run a stored configuration again in `folder`; returns its recording or, where the run crashed, a finding."""
    try:
        execute(config, str(was.provenance.get("experiment", "custom")), folder, quiet=True)
        return read(folder / RECORDING)
    except Exception as error:  # noqa: BLE001 (whatever a run ends of, the check goes on and names it)
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        return Finding("run", None, None, "complete", False, f"crashed: {cause}", Agreement.CHANGED)


def same_but_for_seeds(runs: Sequence[Run]) -> list[list[Run]]:
    """Group runs whose configurations differ only in the seed and what affects no number, in order of their first."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        kept = {key: value for key, value in run.settings.items() if key not in ("seed", *NO_EFFECT)}
        groups.setdefault(json.dumps(kept, sort_keys=True, default=str), []).append(run)
    return list(groups.values())


def with_other_seeds(group: Sequence[Run], config: DictConfig, n: int, folder: Path) -> list[Run] | Finding:
    """Run the group's configuration n times with the smallest seeds that none of the group has; or the first crash.

    Other seeds, since runs with the same ones are no independent sample.
    """
    taken = {run.settings.get("seed", 0) for run in group}
    found: list[Run] = []
    for seed in tqdm(list(islice((seed for seed in count() if seed not in taken), n)), unit="seed", disable=None):
        seeded = config.copy()
        seeded.seed = seed
        new = again(group[0], seeded, folder / str(seed))
        if isinstance(new, Finding):
            return new
        found.append(new)
    return found


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
            f"part runs as workbench from={run.path} {text}"
        )
    OmegaConf.update(config, key, override.value())
    return key


def _leads_out(text: str, allowed: Iterable[str]) -> bool:
    """Tell whether a text could be a path, or an address, that leads out of the folders allowed and the current one."""
    path, other = PurePosixPath(text), PureWindowsPath(text)
    if ".." in other.parts or "://" in text:
        return True
    absolute = path.is_absolute() or bool(other.root) or text.startswith("~")
    return absolute and not any(path.is_relative_to(folder) for folder in allowed)
