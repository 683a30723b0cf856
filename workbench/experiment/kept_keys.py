"""What the workbench's own parts say of themselves, kept between runs: a configuration is then composed, and refused,
without importing what it is made of, which takes longer than all else."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import ListConfig, OmegaConf

from workbench.core.traits import Traits
from workbench.digest import code_digest
from workbench.files import NotWrittenError, whole_file
from workbench.kernel_cache import kept_folder

_PACKAGE = Path(__file__).parents[1]
_OURS = f"{_PACKAGE.name}."
_ABSENT = {"absent": True}
_MOST_KEPT = 64
"""Of a part's traits, by what they depend on; the latest."""


def kept_keys(target: str, describe: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return what `describe` says of a part, strings, numbers, lists and mappings of them; as it said to an earlier
    process, where no source of the workbench has changed since. Of parts of other packages nothing is kept."""
    if not target.startswith(_OURS):
        return describe()
    kept = _kept(target)
    if isinstance(kept, dict):
        return kept
    told = describe()
    if json.loads(json.dumps(told)) == told:
        _keep(target, told)
    return told


def kept_traits(
    target: str, keys: Mapping[str, Any], declare: Callable[[Mapping[str, Any]], Traits | None]
) -> Traits | None:
    """Return what `declare` says of a part with these keys, among which nested parts stand with their traits; None
    where its class declares nothing. As it said to an earlier process, where all that it looked at then is the same."""
    if not target.startswith(_OURS):
        return declare(keys)
    name = f"{target}.traits"
    kept = _kept(name)
    entries = kept if isinstance(kept, list) else []
    with suppress(ValueError, KeyError, TypeError, AttributeError):  # not what was written here
        for looked_at, told in entries:
            if all(_plain(keys[key]) == value if key in keys else value == _ABSENT for key, value in looked_at.items()):
                return _traits(told)
    looking = _Looking(keys)
    traits = declare(looking)
    with suppress(TypeError):  # what JSON has no words for is not kept
        looked_at = {key: _plain(keys[key]) if key in keys else _ABSENT for key in sorted(looking.looked_at)}
        _keep(name, [*entries, [looked_at, _plain(traits)]][-_MOST_KEPT:])
    return traits


class _Looking(Mapping[str, Any]):
    """A part's keys, which remember those that somebody looked at."""

    def __init__(self, keys: Mapping[str, Any]) -> None:
        self.keys_of_part, self.looked_at = keys, set[str]()

    def __getitem__(self, key: str) -> Any:
        self.looked_at.add(key)
        return self.keys_of_part[key]

    def __iter__(self) -> Iterator[str]:
        self.looked_at |= self.keys_of_part.keys()
        return iter(self.keys_of_part)

    def __len__(self) -> int:
        self.looked_at |= self.keys_of_part.keys()
        return len(self.keys_of_part)


def _plain(value: Any) -> Any:
    """What JSON gives back as it was; raises TypeError for what it has no words for."""
    if isinstance(value, Traits):
        needs = {group: sorted(words) for group, words in value.needs.items()}
        return {"offers": sorted(value.offers), "needs": needs, "lacks": value.lacks}
    if isinstance(value, ListConfig):
        value = OmegaConf.to_container(value, resolve=True)
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if value is None or isinstance(value, str | int | float):
        return value
    raise TypeError(f"expected plain values, found {value!r}")


def _traits(told: Mapping[str, Any] | None) -> Traits | None:
    if told is None:
        return None
    needs = {str(group): frozenset(words) for group, words in told["needs"].items()}
    return Traits(frozenset(told["offers"]), needs, str(told["lacks"]))


def _kept(name: str) -> Any:
    """What an earlier process kept under a name, None where there is nothing that can be used."""
    with suppress(OSError, ValueError, KeyError, TypeError):  # missing, or not what was written here
        kept = json.loads(_path(name).read_text(encoding="utf-8"))
        if kept["code"] == _code():
            return kept["told"]
    return None


def _keep(name: str, told: Any) -> None:
    with suppress(NotWrittenError, OSError), whole_file(_path(name), parents=True) as part:
        part.write_text(json.dumps({"code": _code(), "told": told}), encoding="utf-8")


def _path(name: str) -> Path:
    return kept_folder(_PACKAGE) / "keys" / f"{name}.json"


@cache
def _code() -> str:
    return code_digest()
