"""From a configuration to live objects, for targets of the workbench only."""

from collections.abc import Mapping
from importlib import import_module
from inspect import signature
from typing import Any

from hydra.utils import get_object, instantiate
from omegaconf import DictConfig, ListConfig, OmegaConf

from workbench.errors import InputError

PACKAGE = "workbench"


def check_targets(config: DictConfig | ListConfig, place: str = "") -> None:
    """Refuse a configuration in which any `_target_` is not a class or function defined in the workbench itself.

    A configuration may come from a stranger's recording, so this runs over the whole of it before anything is built.
    Raises InputError naming the place and the target.
    """
    plain = OmegaConf.to_container(config, resolve=True)
    _check(plain, place)


def build(node: DictConfig, **live: object) -> Any:
    """Call the node's target with its keys and those of the live objects that it has parameters for.

    Nodes below it that have a target are built in the same way, with the same live objects.
    Raises InputError for a foreign target or a key the target does not know; what the target itself raises comes
    through unchanged.
    """
    check_targets(node)
    known = signature(get_object(node["_target_"])).parameters
    if unknown := sorted(str(key) for key in node if key != "_target_" and key not in known):
        raise InputError(f"config: {node['_target_']} has no parameter {unknown[0]!r}")  # +group.key=… skips the schema
    wanted = {name: value for name, value in live.items() if name in known}
    nested = {str(key): _built(node[key], live) for key in node if _has_target(node, key)}
    return instantiate(node, _partial_=True, _recursive_=False, _convert_="all")(**wanted, **nested)


def _built(node: DictConfig, live: Mapping[str, object]) -> Any:
    """What the node, or every node under a name in it, builds."""
    return build(node, **live) if "_target_" in node else {str(key): _built(node[key], live) for key in node}


def _has_target(node: DictConfig, key: Any) -> bool:
    if OmegaConf.is_missing(node, key):
        return False
    inner = node[key]
    return isinstance(inner, DictConfig) and ("_target_" in inner or any(_has_target(inner, name) for name in inner))


def _check(value: object, place: str) -> None:
    if isinstance(value, list):
        for index, item in enumerate(value):
            _check(item, f"{place}[{index}]")
    if isinstance(value, dict):
        for key, item in value.items():
            here = f"{place}.{key}" if place else str(key)
            if key == "_target_" and not _is_ours(item):
                raise InputError(f"config: {here} must name a part of the {PACKAGE}, refused {item!r}")
            _check(item, here)


def _is_ours(target: object) -> bool:
    if not isinstance(target, str) or not target.startswith(f"{PACKAGE}."):
        return False
    module, _, name = target.rpartition(".")
    try:
        found = getattr(import_module(module), name, None)
    except ModuleNotFoundError:
        return False
    return callable(found) and str(getattr(found, "__module__", "")).startswith(f"{PACKAGE}.")
