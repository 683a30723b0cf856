"""The configuration: its top level, and the keys of every component, read off the signature of its class.

A constructor's keyword-only or defaulted parameters are the component's keys, with their types and defaults, so that
neither is written twice and a typo or a wrong type in an override is an error that names the key.
"""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, make_dataclass
from functools import lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from hydra import compose, initialize_config_module, version
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import MISSING, DictConfig, ListConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from workbench.experiment.config import options as parts
from workbench.experiment.config.instantiate import keys_of, resolved
from workbench.experiment.config.resolvers import RESOLVERS
from workbench.utils.errors import InputError

_PLAIN = (str, int, float, bool)
IF_CHOSEN = "if_chosen"
"""Group of the options that are made up here, and key of an experiment's file: what it sets of particular parts."""

LITERAL = "paper.literal"
"""Place under `if_chosen` of what an experiment sets where it is to be as its paper writes it."""


@dataclass
class _Paths:
    """data: folder with recorded motion and video. cache: folder for what can be made again."""

    data: str | None = None
    cache: str = MISSING


def _section(*keys: str, lists: Sequence[str] = ()) -> type:
    """Return the type of a section with these keys, of any value, and these of lists, to which resolvers may lead."""
    columns = [(key, Any, MISSING) for key in keys] + [(key, list[Any], MISSING) for key in lists]
    return make_dataclass("Section", columns)


_CLIPS = _section("validation", "test", "test_run", "test_walk_run", "test_full", "held_out", "split")


@dataclass
class _Tolerance:
    """What a metric may move by: absolute, in its unit, or relative to what it was."""

    absolute: float = 0.0
    relative: float = 0.0


@dataclass
class _Sweep:
    """resume, reuse: folders of earlier sweeps. job_ids: numbers of those to run. objective: what a tuner minimises.

    fail_fast: begin no job after one has failed. stop_if: ends a run early.
    """

    resume: str | None = None
    reuse: str | None = None
    fail_fast: bool = False
    stop_if: str | None = None
    job_ids: list[int] | None = None
    objective: str | None = None


@dataclass
class RunSchema:
    """Top level of a configuration.

    A study's experiment sets unused groups to null. Without a study the run tracks.

    component_packages: further packages with options. Only the command line may set it.
    assumptions: side information that the experiment uses. A run records what it actually used.
    paper: "literal" for an experiment exactly as published, else "ours".
    """

    body: Any = None
    dataset: Any = None
    prior: Any = None
    likelihood: Any = None
    inference: Any = None
    recorder: Any = None
    study: Any = None
    seed: int = 0
    n_threads: int | None = None
    component_packages: list[str] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    paper: str = "ours"
    training: Any = field(default_factory=_section("motions", lists=["exclude"]))
    default_motions: Any = field(default_factory=_section("walk", "run", "walks", "library"))
    clips: Any = field(default_factory=_CLIPS)
    protocol: Any = field(default_factory=_section("split", "activity", "occlusion"))
    paths: _Paths = field(default_factory=_Paths)
    check: dict[str, _Tolerance] = field(default_factory=dict)
    sweep: _Sweep = field(default_factory=_Sweep)


def prepare_hydra() -> None:
    """Register with Hydra the options, the schema of the top level, and the resolvers of `conf/`."""
    ConfigStore.instance().store(name="run_schema", node=RunSchema)
    for plugin in (ComponentSource, _ComponentSearchPath):
        Plugins.instance().register(plugin)
    for name, resolver in RESOLVERS.items():
        OmegaConf.register_new_resolver(name, resolver, replace=True)


def composed(overrides: Sequence[str], with_hydra: bool = False) -> DictConfig:
    """Compose the configuration as the command `workbench` does, also within another Hydra application.

    with_hydra: keep Hydra's own settings, under `hydra`. Raises HydraException and OmegaConfBaseException as Hydra.
    """
    prepare_hydra()
    application, base = GlobalHydra.instance().hydra, version.getbase()
    GlobalHydra.instance().clear()
    try:
        with initialize_config_module("workbench.conf", version_base="1.3"):
            return compose("config", list(overrides), return_hydra_config=with_hydra)
    finally:
        GlobalHydra.instance().hydra = application
        if application is not None and base is not None:
            version.VersionBase.instance().setbase(base)


@lru_cache(maxsize=256)
def _schema_of(target: str) -> type:
    """Return a dataclass with `_target_` and a typed field for each key of a component; InputError as `resolved`."""
    component = resolved(target)
    columns: list[tuple[str, Any, Any]] = [("_target_", str, f"{component.__module__}.{component.__qualname__}")]
    columns += [(key, _schema_type(hint), _field(default)) for key, (hint, default) in keys_of(component).items()]
    return make_dataclass(f"{component.__name__}_keys", columns)


def _field(default: object) -> Any:
    """Return the dataclass field of a parameter with this default; of a component, which the class makes, None."""
    if default is inspect.Parameter.empty:
        return MISSING
    if isinstance(default, Mapping):
        return field(default_factory=lambda: deepcopy(dict(default)))
    if isinstance(default, tuple | list):
        return field(default_factory=lambda: deepcopy(list(default)))
    return default if isinstance(default, (*_PLAIN, NoneType)) else None


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


class ComponentSource(ConfigSource):
    """The folders with options that `parts` has when Hydra starts, looked through in this order.

    An option `if_chosen/EXPERIMENT,group=option,group=option,…` is what the experiment sets of the parts chosen:

        if_chosen:
          prior.jitter: {sigma: 0.01}

    in its own file, or in that of an experiment it begins with, holds where the prior is jitter, and only there.
    Under `if_chosen: {paper.literal: …}` it says likewise how its paper departs from that.
    """

    def __init__(self, provider: str, path: str) -> None:
        super().__init__(provider, path)
        self._packages, self._folders = parts.packages(), list(parts.folders().values())

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Let a launcher's worker, which has not seen the command line, choose and build the same components."""
        self.__dict__.update(state)
        parts.name_parts(self._packages)

    @staticmethod
    def scheme() -> str:
        """Return what its places begin with."""
        return "components"

    def available(self) -> bool:
        """Return whether it leads anywhere; names are looked up when they are given."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Return whether a package has this folder."""
        return any((folder / config_path).is_dir() for folder in self._folders)

    def is_config(self, config_path: str) -> bool:
        """Return whether a package has this file, or it is one of those made up here."""
        return config_path.startswith(f"{IF_CHOSEN}/") or self._find(config_path) is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Names of the groups and options in a folder; those that begin with an underscore are not for choosing."""
        found = [path for folder in self._folders for path in (folder / config_path).glob("[!_]*")]
        groups = {path.name for path in found if path.is_dir() and results_filter is not ObjectType.CONFIG}
        files = {path.stem for path in found if path.suffix == ".yaml" and results_filter is not ObjectType.GROUP}
        return sorted(groups | files)

    def load_config(self, config_path: str) -> ConfigResult:
        """The option, typed. Raises ConfigCompositionException for a key that its class does not know, naming both."""
        if config_path.startswith(f"{IF_CHOSEN}/"):
            experiment, *chosen = config_path.removeprefix(f"{IF_CHOSEN}/").removesuffix(".yaml").split(",")
            config: Any = self._chosen_settings(experiment, set(chosen))
            header: dict[str, str | None] = {"package": "_global_"}
        else:
            path = self._find(config_path)
            assert path is not None
            text = _text(path)
            self._check_options(config_path, _parsed(text, str(path)))
            config = deepcopy(_typed_text(text, str(path), parts.packages()))
            header = ConfigSource._get_header_dict(text)
        return ConfigResult(provider=self.provider, path=self.full_path(), config=config, header=header)

    def _find(self, config_path: str) -> Path | None:
        return parts.find(self._folders, self._normalize_file_name(config_path))

    def _check_options(self, config_path: str, config: DictConfig) -> None:
        """Raise ConfigCompositionException, naming the file, where its defaults list chooses an option that is none."""
        entries: Any = OmegaConf.to_container(config["defaults"], resolve=False) if "defaults" in config else []
        for group, option in (item for entry in entries if isinstance(entry, dict) for item in entry.items()):
            name = f"{group.split()[-1].partition('@')[0].lstrip('/')}/{option}"
            fixed = isinstance(option, str) and "$" not in option and name.partition("/")[0] in parts.GROUPS
            if fixed and self._find(name) is None:
                raise ConfigCompositionException(f"In '{config_path}': Could not find '{name}'")

    def _chosen_settings(self, experiment: str, chosen: set[str]) -> DictConfig:
        """Collect what an experiment and those it begins with set of the parts chosen, each `group.option`.

        An experiment's own settings follow those of the ones it begins with, and its paper's words follow all. Raises
        ConfigCompositionException for an experiment that is to be as its paper writes it and does not say how.
        """
        settings, found = dict(self._settings(experiment)), OmegaConf.create({})
        if LITERAL in chosen and LITERAL not in settings.get(experiment, {}):
            raise ConfigCompositionException(f"paper=literal: experiment={experiment} is in none of the papers")
        every = list(settings.items())
        every += [(name, own.get(LITERAL, {})) for name, own in every] if LITERAL in chosen else []
        for name, own in every:
            for place, keys in ((str(place), keys) for place, keys in own.items()):
                group, _, option = place.partition(".")
                if place != LITERAL and (group not in parts.GROUPS or self._find(f"{group}/{option}") is None):
                    raise ConfigCompositionException(f"In 'experiment/{name}': {IF_CHOSEN}: there is no part {place}")
                if not isinstance(keys, DictConfig):
                    raise ConfigCompositionException(
                        f"In 'experiment/{name}': {IF_CHOSEN}: {place}: expected keys and values, found {keys}"
                    )
                if place != LITERAL and place in chosen:
                    found.merge_with({group: keys})
        return found

    def _settings(self, experiment: str) -> Iterator[tuple[str, DictConfig]]:
        """Yield what an experiment and those it begins with have under IF_CHOSEN, by their names; its own last."""
        if path := self._find(f"experiment/{experiment}"):  # where there is none, Hydra itself refuses
            own = _parsed(_text(path), str(path))
            for base in own.get("defaults", ()):
                if isinstance(base, str) and base != "_self_":
                    yield from self._settings(base)
            yield experiment, own.get(IF_CHOSEN) or OmegaConf.create({})


class _ComponentSearchPath(SearchPathPlugin):
    """Puts the options of all packages and folders where Hydra would look for ours alone."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Called by Hydra whenever it is started, so that packages named since then are found too."""
        for element in search_path.get_path():
            if element.path == f"pkg://{parts.OURS}.conf":
                element.path = f"{ComponentSource.scheme()}://{','.join(parts.folders())}"


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except ValueError as error:
        raise ConfigCompositionException(f"{path}: expected a text in UTF-8: {error}") from None


@lru_cache(maxsize=512)
def _parsed(text: str, file: str) -> DictConfig:
    """Parse YAML, once for all configurations that a process composes; the result is to be left as it is.

    Raises ConfigCompositionException, naming the file, for anything but a mapping, and for a list that is none.
    """
    try:
        config = OmegaConf.create(text)
    except (YAMLError, OmegaConfBaseException) as error:
        raise ConfigCompositionException(f"{file}: expected YAML: {' '.join(str(error).split())}") from None
    kinds = {"defaults": (ListConfig, "a list"), IF_CHOSEN: (DictConfig | NoneType, "a mapping")}
    if not isinstance(config, DictConfig):
        raise ConfigCompositionException(f"{file}: expected a mapping of keys to values")
    for key, (kind, name) in kinds.items():
        if key in config and not isinstance(config[key], kind):
            raise ConfigCompositionException(f"{file}: {key}: expected {name}, found {config[key]}")
    return config


@lru_cache(maxsize=512)
def _typed_text(text: str, file: str, _packages: tuple[str, ...]) -> DictConfig:
    """Parse and type a file's text, without what an experiment sets of particular parts; to be left as it is.

    _packages: those whose classes may be named, on which it depends, too.
    """
    plain: Any = OmegaConf.to_container(_parsed(text, file))
    plain.pop(IF_CHOSEN, None)
    return OmegaConf.create(typed(plain, file))


def typed(value: Any, file: str) -> Any:
    """Merge every mapping that names a class over the schema of that class, so that its keys are checked.

    value: of plain mappings and lists. Raises ConfigCompositionException, naming the file, for a key that is none or a
    value of another type.
    """
    if isinstance(value, list):
        return [typed(item, file) for item in value]
    if not isinstance(value, dict):
        return value
    config = {key: item if key == "hydra" else typed(item, file) for key, item in value.items()}  # Hydra checks its own
    if "_target_" not in config:
        return config
    try:
        defaults = {key: config.pop(key) for key in ("defaults",) if key in config}
        schema = OmegaConf.structured(_schema_of(str(config["_target_"])))
        for key in schema:  # a command line may fill mappings that the class leaves empty without a plus
            node = schema._get_node(key)
            if isinstance(node, DictConfig) and (node._is_missing() or not len(node)):
                OmegaConf.set_struct(node, False)
        known = [str(key) for key in schema]  # which `in` would not find where they have no default
        if unknown := [str(key) for key in config if key not in known]:
            keys = ", ".join(key for key in known if key != "_target_") or "none"
            raise InputError(f"{config['_target_']} has no key {unknown[0]!r}; it has {keys}")
        merged: Any = OmegaConf.merge(schema, config)
        with open_dict(merged):
            merged.update(defaults)
        return merged
    except (InputError, OmegaConfBaseException) as error:
        raise ConfigCompositionException(f"{file}: {' '.join(str(error).split())}") from error
