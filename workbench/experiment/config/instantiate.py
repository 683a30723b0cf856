"""From a configuration to live objects, for targets of the workbench and of packages that the user named only."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import OURS, how_to_allow, is_allowed, targets
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError
from workbench.utils.signals import deferred

_LIVE = frozenset(
    {
        "config_yaml",
        "frames_hz",
        "likelihood",
        "phase_ends",
        "prior",
        "provenance",
        "run_id",
        "settings",
        "uninformative_metrics",
    }
)
"""Parameters that the run fills with live objects, so that they are no keys of a configuration; as are those whose type
says so: functions, arrays, paths, and the classes of `body` and `core` (a body, a clip, what is known of it)."""


def check_targets(config: DictConfig) -> None:
    """Raise InputError, naming the place, for a `_target_` that no option of the workbench or a named package builds.

    A configuration may come from an untrusted recording, so all names are checked before anything is imported, and all
    are imported before anything is built.
    """
    places = leaves(OmegaConf.to_container(config, resolve=True), lists=True)
    found = {place: value for place, value in places if "_target_" in place}
    known = targets()
    for place, target in found.items():
        if not (place.endswith("_target_") and isinstance(target, str) and target in known):
            raise _refusal(target, f"{place} ")
    for place, target in found.items():
        resolved(target, f"{place} ")


def _refusal(target: object, place: str) -> InputError:
    return InputError(f"config: {place}must name a part of the {OURS}, refused {target!r}{how_to_allow(target)}")


def build(node: DictConfig, **live: object) -> Any:
    """Call the node's target with its keys and those of the live objects that it has parameters for.

    Nodes below it that have a target are built in the same way, with the same live objects.
    Raises InputError for a foreign target or a key the target does not know; what the target itself raises comes
    through unchanged.
    """
    if not isinstance(node, DictConfig):
        raise InputError(f"config: expected a part with the keys of its class, found {node!r}")
    component = resolved(node["_target_"])
    known = inspect.signature(component).parameters
    keys = [str(key) for key in node if key != "_target_"]
    if unknown := sorted(key for key in keys if key not in known):
        raise InputError(f"config: {node['_target_']} has no parameter {unknown[0]!r}")  # +group.key=… skips the schema
    plain: Any = OmegaConf.to_container(node, resolve=True, throw_on_missing=True)
    built = {key: _built(node[key], live) for key in keys if _has_target(node[key])}
    given = {name: value for name, value in live.items() if name in known}
    return component(**given | {key: plain[key] for key in keys} | built)


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
    raise _refusal(target, place)


def keys_of(target: Callable[..., object]) -> dict[str, tuple[Any, Any]]:
    """Type and default, `inspect.Parameter.empty` for none, of every parameter of `target` that is not live."""
    constructed = inspect.isclass(target) and not is_dataclass(target)  # whose fields say more than its constructor
    types = get_type_hints(target.__init__ if constructed else target)
    found = {name: (types.get(name, Any), each.default) for name, each in inspect.signature(target).parameters.items()}
    return {name: each for name, each in found.items() if name not in _LIVE and not _is_live(each[0])}


def _is_live(hint: Any) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return any(map(_is_live, get_args(hint)))
    of_run = getattr(hint, "__module__", "").startswith(("workbench.body.", "workbench.core."))
    made = inspect.isclass(hint) and of_run and not getattr(hint, "_is_protocol", False)
    return made or hint in (Callable, Path) or getattr(get_origin(hint), "__name__", "") in ("Callable", "ndarray")


def _built(node: DictConfig, live: Mapping[str, object]) -> Any:
    """Build the node, or every node under a name in it."""
    return build(node, **live) if "_target_" in node else {str(key): _built(node[key], live) for key in node}


def _has_target(node: object) -> bool:
    return isinstance(node, DictConfig) and ("_target_" in node or any(_has_target(node[name]) for name in node))
