"""Resolvers of `conf/`, among them those of the protocol of strangers.

A clip's half, and what a run is shown with, follow from names by a hash that nobody chose: the half from the clip's
name, what is shown from the clip's and the seed's. So neither depends on what else is in the list, and every seed of a
clip has its own view.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

from omegaconf import ListConfig

from workbench.motion.formats.names import clip_name, excluded_subjects
from workbench.utils.errors import InputError

_HALVES = ("report", "choose")
"""Of the clips, by the hash of their names: whose numbers are reported, and those to choose parameters by."""

_Activities = Mapping[str, Mapping[str, int]]
"""The first frame shown of every clip, by the clip's name, by the activity."""


def _hashed(text: str, *options: object) -> object:
    """Pick one of the options by the SHA-256 of a text: the remainder of its first eight bytes, which hardly favours
    any. Raises InputError where there is none."""
    if not options:
        raise InputError(f"hashed: expected options to pick one for {text!r}, found none")
    return options[int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") % len(options)]


def _half_of(clip: object) -> str:
    """Return which of _HALVES a clip belongs to, by its name or what a command line takes for it, see `clip_name`."""
    return _HALVES[hashlib.sha256(clip_name(str(clip)).encode()).digest()[0] % 2]


def _clips_of(activities: _Activities, half: str | None = None) -> list[str]:
    """List the clips of all activities, of one half or of both; raises InputError for another half."""
    if half is not None and half not in _HALVES:
        raise InputError(f"clips: half must be one of {', '.join(_HALVES)} or null, found {half!r}")
    every = [clip for clips in activities.values() for clip in clips]
    return [clip for clip in every if half in (None, _half_of(clip))]


def _activity_of(activities: _Activities, clip: object) -> str | None:
    """Name what the person does in a clip; None for a clip that is not listed."""
    return next((name for name, clips in activities.items() if clip_name(str(clip)) in clips), None)


def _first_frame(activities: _Activities, clip: object) -> int:
    """Return the first frame shown of a clip, at 30 Hz; 0 of one that is not listed."""
    name = clip_name(str(clip))
    return next((int(clips[name]) for clips in activities.values() if name in clips), 0)


def _given(value: str | None, then: object, otherwise: object) -> object:
    """Return `then` where there is a value, `otherwise` where it is null or the built-in walker."""
    return otherwise if value in (None, "builtin") else then


def _performers(*motions: Any, by_style: bool = False) -> list[str]:
    """Name who is tracked, whom learned priors leave out: those of motions, each a name, a list of names or null."""
    listed = (each if isinstance(each, list | ListConfig) else [each] for each in motions if each is not None)
    return excluded_subjects((str(name) for names in listed for name in names), by_style)


def _each(values: Sequence[str]) -> str:
    """Write a list as a sweep's choices."""
    return ",".join(f"'{value}'" for value in values)


RESOLVERS: Mapping[str, Callable[..., object]] = MappingProxyType(
    {
        "given": _given, "performers": _performers, "styles": partial(_performers, by_style=True), "each": _each,
        "hashed": _hashed, "half_of": _half_of, "clips_of": _clips_of, "activity_of": _activity_of,
        "first_frame": _first_frame,
    }
)  # fmt: skip
"""By name, as `${name:…}` refers to them."""
