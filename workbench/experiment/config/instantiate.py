"""Build live objects from a configuration; targets of the workbench and of allowed packages only."""

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import OURS, hint_to_allow, is_allowed, is_target
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError
from workbench.utils.input_path import InputPath
from workbench.utils.signals import deferred

PLAIN = (str, int, float, bool)
_LIVE = frozenset({
    "config_yaml", "frames_hz", "likelihood", "phase_ends", "prior", "provenance", "run_id", "settings",
    "uninformative_metrics", "camera_turns",
})  # fmt: skip
"""Parameters that the run fills with live objects and that are no configuration keys.

So are parameters of these types: functions, arrays, paths, and the classes of `body` and `core`."""


def check_targets(config: DictConfig) -> None:
    """Raise InputError, with the key, for a `_target_` that is not in the options of the allowed packages.

    A configuration may come from an untrusted recording. All names are checked before anything is imported, and all
    targets are imported before anything is built.
    """
    places = leaves(OmegaConf.to_container(config, resolve=True), lists=True)
    named = {place: value for place, value in places if "_target_" in place}
    for place, target in named.items():
        if not (place.endswith("_target_") and is_target(target)):
            raise _refusal(target, f"{place} ")
    for place, target in named.items():
        import_target(target, f"{place} ")


def _refusal(target: object, place: str) -> InputError:
    return InputError(f"config: {place}expected a component of the {OURS}, found {target!r}{hint_to_allow(target)}")


def build(node: DictConfig, **live: object) -> Any:
    """Return the object of a node: its target called with its keys and with the live objects it has parameters for.

    Nested nodes with a target are built in the same way. Exceptions of the target are not changed.

    Raises
    ------
    InputError : a target that is not allowed, a key that is no configuration key of the target, as the run alone
        supplies live objects, or a value of another type.
    """
    if not isinstance(node, DictConfig):
        raise InputError(f"config: expected a component with its keys, found {node!r}")
    component = import_target(node["_target_"])
    parameters = inspect.signature(component).parameters
    keys = [str(key) for key in node if key != "_target_"]
    if unknown := sorted(set(keys) - set(types := config_keys(component))):
        raise InputError(f"config: {node['_target_']} has no key {unknown[0]!r}")  # +group.key=… skips the schema
    plain: Any = _with_text_keys(OmegaConf.to_container(node, resolve=True, throw_on_missing=True))
    for key in keys:  # a schema cannot express all types
        _check_type(plain[key], types[key][0], f"config: {node['_target_']}: {key}")
    built = {key: _built(node[key], live) for key in keys if _has_target(node[key])}
    matching = {name: value for name, value in live.items() if name in parameters}
    return component(**matching | {key: plain[key] for key in keys} | built)


def _with_text_keys(value: Any) -> Any:
    """Return plain values with the keys of all mappings as text, as names of digits alone are parsed as numbers."""
    if isinstance(value, dict):
        return {str(key): _with_text_keys(item) for key, item in value.items()}
    return [_with_text_keys(item) for item in value] if isinstance(value, list) else value


def import_target(target: str, place: str = "") -> Callable[..., object]:
    """Return the class or function of a dotted name.

    Raises
    ------
    InputError : a target in no option, that does not exist, or that is defined outside the allowed packages.
    """
    if is_target(target):
        module, _, name = target.rpartition(".")
        try:
            with deferred():  # an exception within an import can be lost in C code
                component = getattr(import_module(module), name, None)
        except ModuleNotFoundError as error:
            if not is_allowed(f"{error.name}."):
                raise  # a dependency of the component is missing
            component = None
        if callable(component) and is_allowed(f"{getattr(component, '__module__', '')}."):
            return component
    raise _refusal(target, place)


def config_keys(target: Callable[..., object]) -> dict[str, tuple[Any, Any]]:
    """Return type and default (`inspect.Parameter.empty` for none) of every parameter that is a configuration key."""
    constructed = inspect.isclass(target) and not is_dataclass(target)  # whose fields have the types
    types = get_type_hints(target.__init__ if constructed else target)
    parameters = inspect.signature(target).parameters
    keys = {name: (types.get(name, Any), parameter.default) for name, parameter in parameters.items()}
    return {name: key for name, key in keys.items() if name not in _LIVE and not _is_live(key[0])}


def path_keys(target: Callable[..., object]) -> frozenset[str]:
    """Return the parameters that name files or folders to read: those of type `InputPath`."""
    types = get_type_hints(target.__init__ if inspect.isclass(target) else target, include_extras=True)
    return frozenset(name for name, hint in types.items() if _names_path(hint))


def _names_path(hint: Any) -> bool:
    return bool(hint == InputPath) or any(map(_names_path, get_args(hint)))


def _is_live(hint: Any) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return any(map(_is_live, get_args(hint)))
    of_run = getattr(hint, "__module__", "").startswith(("workbench.body.", "workbench.core."))
    is_built = inspect.isclass(hint) and of_run and not getattr(hint, "_is_protocol", False)
    return is_built or hint in (Callable, Path) or getattr(get_origin(hint), "__name__", "") in ("Callable", "ndarray")


def _built(node: DictConfig, live: Mapping[str, object]) -> Any:
    """Return the object of the node, or the objects of the nodes in it by name."""
    return build(node, **live) if "_target_" in node else {str(key): _built(node[key], live) for key in node}


def _has_target(node: object) -> bool:
    return isinstance(node, DictConfig) and ("_target_" in node or any(_has_target(node[name]) for name in node))


def check_component(node: Any, place: str) -> None:
    """Raise InputError unless plain values are a component with all keys that its class needs, and no others."""
    if not (isinstance(node, Mapping) and isinstance(node.get("_target_"), str)):
        raise InputError(f"{place}: expected a component with a _target_, found {node!r}")
    target, keys = node["_target_"], config_keys(import_target(node["_target_"], f"{place}._target_ "))
    if missing := [key for key, (_, default) in keys.items() if default is inspect.Parameter.empty and key not in node]:
        raise InputError(f"{place}: {target} needs the key {missing[0]!r}, found none")
    for key, value in node.items():
        if key == "_target_":
            continue
        if key not in keys:
            raise InputError(f"{place}.{key}: {target} has no such key; it has {', '.join(keys) or 'none'}")
        _check_type(value, keys[key][0], f"{place}.{key}")


def _check_type(value: Any, hint: Any, place: str) -> None:
    """Raise InputError unless a plain value has the type of a parameter."""
    if not _matches(value, hint, place):
        expected = getattr(hint, "__name__", str(hint)) if inspect.isclass(hint) else str(hint)
        raise InputError(f"{place}: expected {expected.replace('collections.abc.', '')}, found {value!r}")


def _matches(value: Any, hint: Any, place: str) -> bool:
    """Return whether a plain value has the type of a parameter; raises InputError for a wrong component in it."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in (Any, object):
        return True
    if hint is NoneType:
        return value is None
    if origin in (Union, UnionType):
        return any(_matches(value, each, place) for each in inner)
    if hint in PLAIN:
        return type(value) is hint or (hint is float and type(value) is int)
    if origin is Literal:
        return value in inner
    if origin in (tuple, list, Sequence, Collection, Iterable):
        fixed = origin is tuple and Ellipsis not in inner
        fits = isinstance(value, list) and (not fixed or len(value) == len(inner))
        return fits and all(_matches(item, inner[0], f"{place}[{k}]") for k, item in enumerate(value))
    if origin in (dict, Mapping):
        named = isinstance(value, Mapping)
        return named and all(_matches(item, inner[1], f"{place}.{key}") for key, item in value.items())
    if isinstance(value, Mapping) and "_target_" in value:  # a nested component
        check_component(value, place)
        return True
    if hint in (list, tuple, dict):
        return isinstance(value, Mapping if hint is dict else list)
    # a path or an array is for the component to check, which may be a user's own
    return not getattr(hint, "__module__", "").startswith("workbench.")
