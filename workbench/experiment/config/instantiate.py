"""From a configuration to live objects, for targets of the workbench and of packages that a person named only."""

from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import signature
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, ListConfig, OmegaConf

from workbench.experiment.config.options import OURS, how_to_allow, is_allowed, targets
from workbench.utils.errors import InputError
from workbench.utils.signals import deferred


def check_targets(config: DictConfig | ListConfig, place: str = "") -> None:
    """Refuse a configuration in which any `_target_` is not what an option of the workbench or of a package that was
    named builds.

    A configuration may come from a stranger's recording, so this runs over the whole of it before anything is built,
    and over all names before anything is imported. Raises InputError naming the place and the target.
    """
    found = targets_in(OmegaConf.to_container(config, resolve=True), place)
    check_names(found)
    for here, target in found.items():
        resolved(target, f"{here} ")


def check_names(found: Mapping[str, object]) -> None:
    """Refuse targets, by their places, that no option names; nothing is imported. Raises InputError."""
    known = targets() if found else set()
    for here, target in found.items():
        if not (isinstance(target, str) and target in known):
            raise InputError(f"config: {here} must name a part of the {OURS}, refused {target!r}{how_to_allow(target)}")


def build(node: DictConfig, **live: object) -> Any:
    """Call the node's target with its keys and those of the live objects that it has parameters for.

    Nodes below it that have a target are built in the same way, with the same live objects.
    Raises InputError for a foreign target or a key the target does not know; what the target itself raises comes
    through unchanged.
    """
    if not isinstance(node, DictConfig):
        raise InputError(f"config: expected a part with the keys of its class, found {node!r}")
    check_targets(node)
    known = signature(resolved(node["_target_"])).parameters
    if unknown := sorted(str(key) for key in node if key != "_target_" and key not in known):
        raise InputError(f"config: {node['_target_']} has no parameter {unknown[0]!r}")  # +group.key=… skips the schema
    given = {name: value for name, value in live.items() if name in known}
    given |= {str(key): _built(node[key], live) for key in node if _has_target(node, key)}
    return instantiate(node, _partial_=True, _recursive_=False, _convert_="all")(**given)


def resolved(target: str, place: str = "") -> Callable[..., object]:
    """Import the class or function of a dotted name.

    Raises InputError for what no option names, does not exist or is defined outside the packages that may be built
    from.
    """
    if target in targets():
        module, _, name = target.rpartition(".")
        try:
            with deferred():  # an exception within an import can be lost in C code
                found = getattr(import_module(module), name, None)
        except ModuleNotFoundError as error:
            if not is_allowed(f"{error.name}."):
                raise  # the part is there, what it needs is not
            found = None
        if callable(found) and is_allowed(f"{getattr(found, '__module__', '')}."):
            return found
    raise InputError(f"config: {place}must name a part of the {OURS}, refused {target!r}{how_to_allow(target)}")


def _built(node: DictConfig, live: Mapping[str, object]) -> Any:
    """Build the node, or every node under a name in it."""
    return build(node, **live) if "_target_" in node else {str(key): _built(node[key], live) for key in node}


def _has_target(node: DictConfig, key: Any) -> bool:
    if OmegaConf.is_missing(node, key):
        return False
    inner = node[key]
    return isinstance(inner, DictConfig) and ("_target_" in inner or any(_has_target(inner, name) for name in inner))


def targets_in(value: object, place: str) -> dict[str, Any]:
    """Find every `_target_` by its place."""
    if isinstance(value, list):
        return {here: each for k, item in enumerate(value) for here, each in targets_in(item, f"{place}[{k}]").items()}
    found: dict[str, Any] = {}
    if isinstance(value, dict):
        for key, item in value.items():
            here = f"{place}.{key}" if place else str(key)
            found |= {here: item} if key == "_target_" else targets_in(item, here)
    return found
