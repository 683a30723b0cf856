"""A configuration as flat keys, which tables can filter and sort by."""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

_ABOUT_OTHERS = ("check", "clips", "paths", "people", "protocol", "_target_")
"""Keys that say what runs could be about, or where things are, or what their choice says: they tell no run apart."""
_LONGEST_KEY, _LONGEST_TEXT = 120, 300


def leaves(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Go through a nested configuration as dotted keys with their values."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def numbers_and_texts(
    settings: Mapping[str, Any], choices: Mapping[str, str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Tell the keys of a configuration that are numbers from those that are not, by dotted key.

    settings: nested, or with dotted keys. choices: the option chosen by group, which are texts, too. A key is of one
    type in all recordings, by which property it is in, as only such can be columns of one table. Truths and lists are
    texts, as JSON. Left out are empty values, what says nothing of this run, keys of over 120 characters, and what
    follows after 300 characters of a text.
    """
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    for key, value in leaves(settings):
        if value is None or not _tells(key):
            continue
        if isinstance(value, int | float) and not isinstance(value, bool):
            numbers[key] = float(value)
        else:
            texts[key] = (value if isinstance(value, str) else json.dumps(value, default=str))[:_LONGEST_TEXT]
    texts |= {group: option[:_LONGEST_TEXT] for group, option in choices.items() if _tells(group)}
    return numbers, texts


def choices_of(words: str | Iterable[str]) -> dict[str, str]:
    """Read "group=option" words, as a run's provenance has them; of one word a recording makes no list."""
    return dict(str(word).partition("=")[::2] for word in ([words] if isinstance(words, str) else words))


def _tells(key: str) -> bool:
    parts = key.split(".")
    return 0 < len(key) <= _LONGEST_KEY and parts[0] not in _ABOUT_OTHERS and parts[-1] not in _ABOUT_OTHERS
