"""Interpolation resolvers of `conf/`, among them those of experiment=held_out_subjects.

A hash of the clip's name and the seed determines the view and the occlusion, independently of the other clips.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from omegaconf import ListConfig

from workbench.motion.formats.names import clip_name, excluded_subjects
from workbench.utils.errors import InputError

_Protocol = Mapping[str, Mapping[str, Mapping[str, int]]]
"""First frame of every clip, by split, activity and clip name."""


def _hash_choice(text: str, *options: object) -> object:
    """Return the option with the index (first eight bytes of the SHA-256 of `text`) modulo the number of options.

    Raises
    ------
    InputError : no options are given.
    """
    if not options:
        raise InputError(f"hash_choice: expected options after {text!r}, found none")
    return options[int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") % len(options)]


def _listed(protocol: _Protocol, clip: object) -> tuple[str | None, str | None, int]:
    """Return split, activity and first frame (at 30 Hz) of a clip, given by name or path; None, None, 0 for others."""
    name = clip_name(str(clip))
    places = (
        (split, activity, int(clips[name]))
        for split, activities in protocol.items()
        for activity, clips in activities.items()
        if name in clips
    )
    return next(places, (None, None, 0))


def _clips_of(protocol: _Protocol, split: str | None = None) -> list[str]:
    """Return the clips of all activities in one split, or in all for None; InputError for an unknown split."""
    if split is not None and split not in protocol:
        raise InputError(f"clips.split: expected one of {', '.join(protocol)} or null, found {split!r}")
    splits = protocol if split is None else [split]
    return [clip for each in splits for clips in protocol[each].values() for clip in clips]


def _if_set(value: str | None, then: object, otherwise: object) -> object:
    """Return `then`, or `otherwise` if `value` is null or "builtin"."""
    return otherwise if value in (None, "builtin") else then


def _performers(*motions: Any) -> list[str]:
    """Return the performers of the motions, which learned priors exclude.

    motions: each a name, a list of names or None.
    """
    listed = (names if isinstance(names, list | ListConfig) else [names] for names in motions if names is not None)
    return excluded_subjects(str(name) for names in listed for name in names)


def _sweep_over(values: Sequence[str]) -> str:
    """Return the values as the text of a choice sweep."""
    return ",".join(f"'{value}'" for value in values)


RESOLVERS: Mapping[str, Callable[..., object]] = MappingProxyType(
    {
        "activity_of": lambda protocol, clip: _listed(protocol, clip)[1], "clips_of": _clips_of,
        "first_frame": lambda protocol, clip: _listed(protocol, clip)[2], "hash_choice": _hash_choice,
        "if_set": _if_set, "performers": _performers,
        "split_of": lambda protocol, clip: _listed(protocol, clip)[0], "sweep_over": _sweep_over,
    }
)  # fmt: skip
"""Functions by resolver name, as in `${name:…}`."""
