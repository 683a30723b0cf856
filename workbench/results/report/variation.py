"""Variation between runs: the keys of their configurations that distinguish them."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from workbench.recording.settings import NO_EFFECT, leaves

TARGET = "._target_"
EXPERIMENT = "experiment"
_PLACES = (".data", ".cache")

Settings = Mapping[str, Any]
"""A configuration as flat dotted keys, with the experiment's name under `experiment`."""


class Variation(NamedTuple):
    """keys: dotted keys that distinguish the runs, choices first. following: keys that only change with one of them."""

    keys: tuple[str, ...]
    following: tuple[str, ...]


def flat(settings: Mapping[str, Any], experiment: str) -> dict[str, Any]:
    """Return the settings that may affect a run's numbers, except the seed, {dotted key: value}."""
    keys = {key: value for key, value in leaves(settings) if not key.endswith(_PLACES)}
    return {EXPERIMENT: experiment} | {
        key: value for key, value in keys.items() if key.partition(".")[0] not in ("seed", *NO_EFFECT)
    }


def seeds_of_parts(settings: Sequence[Settings], seeds: Sequence[int]) -> set[str]:
    """Return the keys of components' seeds that equal the run's seed in every run, as `dataset.seed=${seed}` does."""
    names = {key for row in settings for key in row if key.endswith(".seed")}
    pairs = list(zip(settings, seeds, strict=True))
    return {name for name in names if all(row.get(name, seed) == seed for row, seed in pairs)}


def what_varied(settings: Sequence[Settings]) -> Variation:
    """Return a minimal set of keys that distinguish different settings.

    A key that repeats another's value is redundant. So is a key that only changes with a choice, a key whose values are
    text: for example the keys of one prior that another prior does not have, or the keys that an experiment sets.
    """
    names = list(dict.fromkeys(key for row in settings for key in row))
    columns = {name: [comparable(row, name) for row in settings] for name in names}
    varied = [name for name in names if len(set(columns[name])) > 1]
    keys: list[str] = []
    following: list[str] = []
    choices = {name for name in varied if all(isinstance(row.get(name, ""), str) for row in settings)}
    for name in sorted(varied, key=lambda name: (name != EXPERIMENT, not name.endswith(TARGET), name not in choices)):
        leaders = []  # keys whose values this one repeats or, where those are choices, follows
        for key in keys:
            pairs = set(zip(columns[key], columns[name], strict=True))
            if columns[key] == columns[name] or (key in choices and len(pairs) == len(set(columns[key]))):
                leaders.append(key)
        if not leaders:
            keys.append(name)
        elif not any(name.startswith(key.removesuffix(TARGET) + ".") for key in leaders):
            following.append(name)
    return Variation(tuple(keys), tuple(following))


def comparable(row: Settings, name: str) -> str:
    """Return a value as JSON; a list of one item as that item, a missing key as an empty list."""
    value = row.get(name, [])
    return json.dumps(value[0] if isinstance(value, list) and len(value) == 1 else value, sort_keys=True, default=str)


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """Return the last parts of dotted keys where unique; of a component's target the group."""
    parts = {key: key.removesuffix(TARGET).split(".") for key in keys}
    last = [words[-1] for words in parts.values()]
    return {key: words[-1] if last.count(words[-1]) == 1 else ".".join(words) for key, words in parts.items()}


def shown(key: str, value: Any) -> str:
    """Return a value as a user types it; a component's class as the component's name."""
    if key.endswith(TARGET):
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(value).rpartition(".")[2]).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return f"[{','.join(shown('', item) for item in value)}]"
    return "none" if value is None else str(value)


def label(keys: Sequence[str], values: Settings) -> str:
    """Return a group's values of the keys in one line: `walking, n_particles=200`."""
    texts = {key: shown(key, values[key]) for key in keys if key in values}
    names = short_names(keys)
    bare = (EXPERIMENT, *(key for key in keys if key.endswith(TARGET)))
    return ", ".join(text if key in bare else f"{names[key]}={text}" for key, text in texts.items())
