"""A configuration as flat keys, by which tables are filtered and sorted."""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

NO_EFFECT = (
    "assumptions", "check", "clips", "component_packages", "default_motions", "n_threads", "paper", "paths", "recorder",
    "training",
)  # fmt: skip
"""Top-level keys of a configuration that do not affect a run's numbers.

They set where and how a run is computed (paths, n_threads, component_packages), the recording (recorder) and tolerances
(check), or hold values that take effect only where a component refers to them (assumptions, clips, default_motions,
paper, training), and are then part of that component's resolved configuration. The seed does affect the numbers.
"""
_NO_COLUMN = (*NO_EFFECT, "protocol")
"""Top-level keys without a column in tables; the protocol only repeats the choice of the dataset."""
_LONGEST_KEY, _LONGEST_TEXT = 120, 300


def leaves(value: Any, place: str = "", *, lists: bool = False) -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys of a nested configuration with their values.

    Parameters
    ----------
    value, place : a mapping and its dotted key.
    lists : descend into lists too, as key[0], key[1] …, and yield empty lists and mappings.
    """
    if isinstance(value, Mapping):
        items = [(f"{place}.{key}" if place else str(key), item) for key, item in value.items()]
    elif lists and isinstance(value, list):
        items = [(f"{place}[{k}]", item) for k, item in enumerate(value)]
    else:
        yield place, value
        return
    if lists and not items:
        yield place, value
    for below, item in items:
        yield from leaves(item, below, lists=lists)


def numbers_and_texts(
    settings: Mapping[str, Any], choices: Mapping[str, str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the numbers and the texts of a configuration by dotted key.

    Truths and lists become texts, as JSON, since a column of a table of recordings has one type. Empty values, keys
    without effect on the numbers and keys of over 120 characters are omitted; texts end after 300 characters.

    Parameters
    ----------
    settings : nested, or with dotted keys.
    choices : the chosen option by group; they become texts.
    """
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    for key, value in leaves(settings):
        if value is None or not _is_column(key):
            continue
        if isinstance(value, int | float) and not isinstance(value, bool):
            numbers[key] = float(value)
        else:
            texts[key] = (value if isinstance(value, str) else json.dumps(value, default=str))[:_LONGEST_TEXT]
    texts |= {group: option[:_LONGEST_TEXT] for group, option in choices.items() if _is_column(group)}
    return numbers, texts


def choices_of(words: str | Iterable[str]) -> dict[str, str]:
    """Return {group: option} of a provenance's words "group=option"; a single one may be a text instead of a list."""
    return dict(str(word).partition("=")[::2] for word in ([words] if isinstance(words, str) else words))


def _is_column(key: str) -> bool:
    parts = key.split(".")
    return 0 < len(key) <= _LONGEST_KEY and parts[0] not in _NO_COLUMN and parts[-1] != "_target_"
