"""The schema of a configuration: of its top level, and of every part, read off the signature of what it builds.

A constructor's keyword-only or defaulted parameters are the part's keys, with their types and defaults, so that
neither is written twice and a typo or a wrong type in an override is an error that names the key.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, make_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from omegaconf import MISSING, OmegaConf

from workbench.errors import InputError
from workbench.experiment.build import resolved

LIVE = frozenset({"config_yaml", "frames_hz", "likelihood", "phase_ends", "prior", "provenance", "run_id"})
"""Parameters that the run fills with live objects, so that they are no keys of a configuration; beside those whose type
says as much: functions, arrays, paths, and the classes of `body` and `core` (a body, a clip, what is known of it)."""

_PLAIN = (str, int, float, bool)


@dataclass
class PathsSchema:
    """data: folder with recorded motion and video. cache: folder for what can be made again."""

    data: str | None = None
    cache: str = MISSING


@dataclass
class LearnSchema:
    """What learned priors learn from, whichever is chosen. motions: see them; missing: what each has of its own.
    leave_out: clips or subjects, such as those that are tracked."""

    motions: str = MISSING
    leave_out: list[Any] = field(default_factory=list)


@dataclass
class PeopleSchema:
    """Who is there, recorded or generated. walk, run: clips. walks: motions of walkers. library: of all activities."""

    walk: str = MISSING
    run: str = MISSING
    walks: str = MISSING
    library: str = MISSING


@dataclass
class ToleranceSchema:
    """What a metric may move by: absolute, in its unit, or relative to what it was."""

    absolute: float = 0.0
    relative: float = 0.0


@dataclass
class SweepSchema:
    """resume: folder of an earlier sweep. jobs: numbers of those to run, None: all. metric: what a tuner minimises."""

    resume: str | None = None
    jobs: list[int] | None = None
    metric: str | None = None


@dataclass
class RunSchema:
    """The top level of a configuration. Groups a study has no use for are null in its experiment; no study: track.

    parts: packages beside the workbench whose parts may be chosen; what says so is the command line, not a file.
    """

    body: Any = None
    dataset: Any = None
    prior: Any = None
    likelihood: Any = None
    inference: Any = None
    recorder: Any = None
    study: Any = None
    seed: int = 0
    threads: int | None = None
    parts: list[str] = field(default_factory=list)
    learn: LearnSchema = field(default_factory=LearnSchema)
    people: PeopleSchema = field(default_factory=PeopleSchema)
    paths: PathsSchema = field(default_factory=PathsSchema)
    check: dict[str, ToleranceSchema] = field(default_factory=dict)
    sweep: SweepSchema = field(default_factory=SweepSchema)


def prepare_hydra() -> None:
    """Tell Hydra where options are and what `conf/` refers to: the schema of its top level, and its resolver."""
    from workbench.experiment.config_source import PartsConfigSource, PartsSearchPath  # which needs schemas itself

    ConfigStore.instance().store(name="run_schema", node=RunSchema)
    for plugin in (PartsConfigSource, PartsSearchPath):
        Plugins.instance().register(plugin)
    OmegaConf.register_new_resolver("given", _given, replace=True)


def schema_of_target(target: str, file: str, with_defaults: bool = False) -> type:
    """The schema of what a dotted name stands for, which is imported; see `schema_of`.

    Raises ConfigCompositionException, naming the file, for what may not be built.
    """
    try:
        return schema_of(resolved(target), with_defaults)
    except InputError as error:
        raise ConfigCompositionException(f"{file}: {error}") from error


def schema_of(target: Callable[..., object], with_defaults: bool = False) -> type:
    """A dataclass with `_target_` and one typed field per parameter of `target` that is not live.

    with_defaults: and a field for Hydra's own list of that name, which it takes out again.
    """
    columns: list[tuple[str, Any, Any]] = [("_target_", str, f"{target.__module__}.{target.__qualname__}")]
    if with_defaults:
        columns.append(("defaults", list[Any], field(default_factory=list)))
    columns += [(name, _schema_type(hint), _default(value)) for name, (hint, value) in keys_of(target).items()]
    return make_dataclass(f"{target.__qualname__}_keys", columns)


def keys_of(target: Callable[..., object]) -> dict[str, tuple[Any, Any]]:
    """Type and default, `inspect.Parameter.empty` for none, of every parameter of `target` that is not live."""
    constructed = inspect.isclass(target) and not is_dataclass(target)  # whose fields say more than its constructor
    types = get_type_hints(target.__init__ if constructed else target)
    found = {name: (types.get(name, Any), each.default) for name, each in inspect.signature(target).parameters.items()}
    return {name: each for name, each in found.items() if name not in LIVE and not _is_live(each[0])}


def _is_live(hint: Any) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return any(map(_is_live, get_args(hint)))
    of_run = getattr(hint, "__module__", "").startswith(("workbench.body.", "workbench.core."))
    made = inspect.isclass(hint) and of_run and not getattr(hint, "_is_protocol", False)
    return made or hint in (Callable, Path) or getattr(get_origin(hint), "__name__", "") in ("Callable", "ndarray")


def _default(value: object) -> Any:
    if value is inspect.Parameter.empty:
        return MISSING
    if isinstance(value, tuple | list):
        return field(default_factory=lambda: list(value))
    if isinstance(value, Mapping):
        return field(default_factory=lambda: dict(value))
    return value if isinstance(value, (*_PLAIN, NoneType)) else None  # a part, which the class makes itself


def _schema_type(hint: Any) -> Any:
    """What OmegaConf calls the type: sequences are lists, mappings are dicts, and parts of any class are anything."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        others = [part for part in inner if part is not NoneType]
        one = _schema_type(others[0]) if len(others) == 1 else Any
        if one is Any or get_origin(one) is dict:  # of which OmegaConf does not take null for something to add to
            return Any
        return one | None
    if hint in _PLAIN:
        return hint
    if origin in (tuple, list, Sequence):
        return list[inner[0] if inner[0] in _PLAIN else Any]  # type: ignore[misc]
    if origin is Literal:
        return str  # the part itself names the choices it knows
    if origin in (dict, Mapping):
        return dict[str, inner[1] if inner[1] in _PLAIN else Any]  # type: ignore[misc]
    return Any


def _given(value: str | None, then: object, otherwise: object) -> object:
    """`then` where there is a value, `otherwise` where it is null or the built-in walker."""
    return otherwise if value in (None, "builtin") else then
