"""Interpolation resolvers of `conf/`, among them those of experiment=held_out_subjects.

A hash of the clip's name assigns the clip to a split. A hash of the clip's name and the seed determines the view and
the occlusion. Neither depends on the other clips of the list.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

from omegaconf import ListConfig

from workbench.motion.formats.names import clip_name, excluded_subjects
from workbench.utils.errors import InputError

_SPLITS = ("test", "validation")
"""Splits of the clips, by the hash of their names: clips to report, and clips for tuning parameters."""

_Activities = Mapping[str, Mapping[str, int]]
"""First frame of every clip, by activity and clip name."""


def _hash_choice(text: str, *options: object) -> object:
    """Return the option with the index (first eight bytes of the SHA-256 of `text`) modulo the number of options.

    Raises
    ------
    InputError : no options are given.
    """
    if not options:
        raise InputError(f"hash_choice: expected options after {text!r}, found none")
    return options[int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") % len(options)]


def _split_of(clip: object) -> str:
    """Return the split of a clip, given by name or path, see `clip_name`."""
    return _SPLITS[hashlib.sha256(clip_name(str(clip)).encode()).digest()[0] % 2]


def _clips_of(activities: _Activities, split: str | None = None) -> list[str]:
    """Return the clips of all activities in one split, or in both for None; InputError for an unknown split."""
    if split is not None and split not in _SPLITS:
        raise InputError(f"clips.split: expected one of {', '.join(_SPLITS)} or null, found {split!r}")
    listed = [clip for clips in activities.values() for clip in clips]
    return [clip for clip in listed if split in (None, _split_of(clip))]


def _activity_of(activities: _Activities, clip: object) -> str | None:
    """Return the activity of a clip, or None for a clip that is not listed."""
    return next((name for name, clips in activities.items() if clip_name(str(clip)) in clips), None)


def _first_frame(activities: _Activities, clip: object) -> int:
    """Return the first frame of a clip, at 30 Hz, or 0 for a clip that is not listed."""
    name = clip_name(str(clip))
    return next((int(clips[name]) for clips in activities.values() if name in clips), 0)


def _if_set(value: str | None, then: object, otherwise: object) -> object:
    """Return `then`, or `otherwise` if `value` is null or "builtin"."""
    return otherwise if value in (None, "builtin") else then


def _performers(*motions: Any, by_style: bool = False) -> list[str]:
    """Return the performers (or styles) of the motions, which learned priors exclude.

    motions: each a name, a list of names or None.
    """
    listed = (names if isinstance(names, list | ListConfig) else [names] for names in motions if names is not None)
    return excluded_subjects((str(name) for names in listed for name in names), by_style)


def _sweep_over(values: Sequence[str]) -> str:
    """Return the values as the text of a choice sweep."""
    return ",".join(f"'{value}'" for value in values)


RESOLVERS: Mapping[str, Callable[..., object]] = MappingProxyType(
    {
        "activity_of": _activity_of, "clips_of": _clips_of, "first_frame": _first_frame, "hash_choice": _hash_choice,
        "if_set": _if_set, "performers": _performers, "split_of": _split_of,
        "styles": partial(_performers, by_style=True), "sweep_over": _sweep_over,
    }
)  # fmt: skip
"""Functions by resolver name, as in `${name:…}`."""
