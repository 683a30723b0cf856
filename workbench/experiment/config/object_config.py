"""What a recording says of parts that were built in Python: read off the live objects, never off a configuration."""

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from workbench.core.keys import kept
from workbench.experiment.config.schema import keys_of
from workbench.experiment.tracking import Parts

PYTHON = "python"
"""In place of an experiment's name for a run of parts that were built in Python."""

_MOST = 100
"""Numbers of an array that are written out; of a longer one its SHA-256 is."""
_PLAIN = (str, bool, int, float)
_MISSING = object()


def settings_of(parts: Parts, seed: int) -> dict[str, Any]:
    """Say what tracks, in the shape of a configuration: experiment, seed, dataset, body, prior, likelihood, inference.

    likelihood: the inference's, where it has one as an attribute.
    """
    likelihood = getattr(parts.inference, "likelihood", None)
    live = {"dataset": parts.clip.dataset, "prior": parts.prior, "likelihood": likelihood, "inference": parts.inference}
    told = {group: None if part is None else described(part) for group, part in live.items()}
    body = {"_target_": _name(parts.body), "shape": parts.body.shape.as_dict()}
    return {"experiment": PYTHON, "seed": seed, "body": body, **told}


def described(part: object) -> dict[str, Any]:
    """The class of a part under `_target_`, and its keys with the values that it has now, parts within it likewise.

    A key whose value the object does not keep, see `core.keys`, is named in `not_kept`, so that nothing is said that is
    not known. Of what was learned there are its arrays, too, or what identifies them.
    """
    told, names, not_kept = kept(part), list(keys_of(type(part))), []
    if is_dataclass(part):
        names += [each.name for each in fields(part) if isinstance(getattr(part, each.name), np.ndarray)]
    found: dict[str, Any] = {"_target_": _name(part)}
    for name in names:
        value = told.get(name, getattr(part, name, _MISSING))
        if value is _MISSING:
            not_kept.append(name)
        else:
            found[name] = _plain(value)
    return found | ({"not_kept": not_kept} if not_kept else {})


def _plain(value: Any) -> Any:
    """A value as YAML has it."""
    if value is None or isinstance(value, _PLAIN):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return value.tolist() if value.size <= _MOST else f"{'×'.join(map(str, value.shape))}, sha256 {digest}"
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(each) for each in value]
    return described(value)


def _name(part: object) -> str:
    return f"{type(part).__module__}.{type(part).__qualname__}"
