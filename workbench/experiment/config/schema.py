"""The schema of a configuration: its top level, and the keys of every component from the signature of its class.

The parameters of a constructor are the component's keys, with their types and defaults. A typo or a wrong type in an
override is therefore an error that names the key.
"""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields, make_dataclass
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

from workbench.experiment.config import options
from workbench.experiment.config.instantiate import PLAIN, check_component, config_keys, import_target
from workbench.experiment.config.resolvers import RESOLVERS
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_CONFIG, check_sizes
from workbench.utils.text import read_text

IF_CHOSEN = "if_chosen"
"""Key of an experiment's file with settings of particular components; group of the options generated from it."""

LITERAL = "paper.literal"
"""Key under `if_chosen` with an experiment's settings exactly as published."""

STUDY = "study"
"""Key under `paper.literal` with settings of the experiment's own study, which is no option of a group."""


@dataclass
class _Paths:
    """data: folder with recorded motion and video. cache: folder of files that can be computed again."""

    data: str | None = None
    cache: str = MISSING


def _section(*keys: str, lists: Sequence[str] = ()) -> type:
    """Return the type of a section with these keys; those in `lists` have lists or resolvers of lists as values."""
    columns = [(key, Any, MISSING) for key in keys] + [(key, list[Any], MISSING) for key in lists]
    return make_dataclass("Section", columns)


_CLIPS = _section("validation", "test", "test_run", "test_walk_run", "long_walk", "test_full", "held_out", "split")


@dataclass
class _Tolerance:
    """Tolerance of a metric: absolute, in its unit, and relative to the recorded value."""

    absolute: float = 0.0
    relative: float = 0.0


@dataclass
class _Sweep:
    """resume, reuse: folders of earlier sweeps. job_ids: jobs to run. objective: the metric that a tuner minimises.

    fail_fast: start no job after a failed one. stop_if: condition that ends a run early.
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
    default_motions: Any = field(default_factory=_section("walk", "cmu_walk", "run", "walks", "library"))
    clips: Any = field(default_factory=_CLIPS)
    protocol: Any = field(default_factory=_section("split", "activity", "occlusion"))
    paths: _Paths = field(default_factory=_Paths)
    check: dict[str, _Tolerance] = field(default_factory=dict)
    sweep: _Sweep = field(default_factory=_Sweep)


def prepare_hydra() -> None:
    """Register the options, the schema of the top level and the resolvers of `conf/` with Hydra."""
    ConfigStore.instance().store(name="run_schema", node=RunSchema)
    for plugin in (ComponentSource, _ComponentSearchPath):
        Plugins.instance().register(plugin)
    for name, resolver in RESOLVERS.items():
        OmegaConf.register_new_resolver(name, resolver, replace=True)


def composed(overrides: Sequence[str], with_hydra: bool = False) -> DictConfig:
    """Return the composed configuration, as the command `workbench` composes it; works within a Hydra application.

    with_hydra: include Hydra's settings, under `hydra`. Raises HydraException and OmegaConfBaseException as Hydra, and
    InputError for a number out of bounds.
    """
    prepare_hydra()
    application, base = GlobalHydra.instance().hydra, version.getbase()
    GlobalHydra.instance().clear()
    try:
        with initialize_config_module("workbench.conf", version_base="1.3"):
            config = compose("config", list(overrides), return_hydra_config=with_hydra)
    finally:
        GlobalHydra.instance().hydra = application
        if application is not None and base is not None:
            version.VersionBase.instance().setbase(base)
    plain: Any = OmegaConf.to_container(config)
    check_sizes({key: value for key, value in plain.items() if key != "hydra"})
    return config


@lru_cache(maxsize=256)
def _schema_of(target: str) -> type:
    """Return a dataclass with `_target_` and a typed field for each key of a component; InputError: `import_target`."""
    component = import_target(target)
    columns: list[tuple[str, Any, Any]] = [("_target_", str, f"{component.__module__}.{component.__qualname__}")]
    columns += [(key, _schema_type(hint), _field(default)) for key, (hint, default) in config_keys(component).items()]
    return make_dataclass(f"{component.__name__}_keys", columns)


def _field(default: object) -> Any:
    """Return the dataclass field of a parameter with this default; None for a default that is an object."""
    if default is inspect.Parameter.empty:
        return MISSING
    if isinstance(default, Mapping):
        return field(default_factory=lambda: deepcopy(dict(default)))
    if isinstance(default, tuple | list):
        return field(default_factory=lambda: deepcopy(list(default)))
    return default if isinstance(default, (*PLAIN, NoneType)) else None


def _schema_type(hint: Any) -> Any:
    """Return OmegaConf's type: sequences are lists, mappings are dicts, and objects of any class are Any."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        others = [component for component in inner if component is not NoneType]
        one = _schema_type(others[0]) if len(others) == 1 else Any
        if one is Any or get_origin(one) is dict:  # OmegaConf cannot add keys to an optional dict that is null
            return Any
        return one | None
    if hint in PLAIN:
        return hint
    if origin in (tuple, list, Sequence):
        return list[inner[0] if inner[0] in PLAIN else Any]  # type: ignore[misc]
    if origin is Literal:
        return str  # the component checks the choice
    if origin in (dict, Mapping):
        # any keys: a camera's name of digits alone is a number, which `build` turns into a text
        return dict[Any, inner[1] if inner[1] in PLAIN else Any]  # type: ignore[misc]
    return Any


class ComponentSource(ConfigSource):
    """Hydra's source of the options in the folders of all packages.

    An option `if_chosen/EXPERIMENT,group.option,group.option,…` contains the experiment's settings of the chosen
    components. Its file, or that of an experiment in its defaults list, defines them:

        if_chosen:
          prior.ar_offsets: {sigma: 0.01}

    This setting applies only if prior=ar_offsets is chosen. The settings under `if_chosen: {paper.literal: …}`
    reproduce the published experiment.
    """

    def __init__(self, provider: str, path: str) -> None:
        super().__init__(provider, path)
        self._packages, self._folders = options.packages(), list(options.folders().values())

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Allow the same packages in a launcher's worker, which has no command line."""
        self.__dict__.update(state)
        options.allow_packages(self._packages)

    @staticmethod
    def scheme() -> str:
        """Return the scheme of its paths."""
        return "components"

    def available(self) -> bool:
        """Return True: options are looked up on demand."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Return whether a package has this folder."""
        return any((folder / config_path).is_dir() for folder in self._folders)

    def is_config(self, config_path: str) -> bool:
        """Return whether a package has this file, or the option is generated here."""
        return config_path.startswith(f"{IF_CHOSEN}/") or self._find(config_path) is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Return the groups and options in a folder, except those whose names begin with an underscore."""
        paths = [path for folder in self._folders for path in (folder / config_path).glob("[!_]*")]
        groups = {path.name for path in paths if path.is_dir() and results_filter is not ObjectType.CONFIG}
        files = {path.stem for path in paths if path.suffix == ".yaml" and results_filter is not ObjectType.GROUP}
        return sorted(groups | files)

    def load_config(self, config_path: str) -> ConfigResult:
        """Return the typed option; ConfigCompositionException, with both names, for a key that is not its class's."""
        if config_path.startswith(f"{IF_CHOSEN}/"):
            experiment, *chosen = config_path.removeprefix(f"{IF_CHOSEN}/").removesuffix(".yaml").split(",")
            config: Any = self._chosen_settings(experiment, set(chosen))
            header: dict[str, str | None] = {"package": "_global_"}
        else:
            path = self._find(config_path)
            assert path is not None
            text = _text(path)
            self._check_options(config_path, _parsed(text, str(path)))
            config = deepcopy(_typed_text(text, str(path), options.packages()))
            header = ConfigSource._get_header_dict(text)
        return ConfigResult(provider=self.provider, path=self.full_path(), config=config, header=header)

    def _find(self, config_path: str) -> Path | None:
        return options.find(self._folders, self._normalize_file_name(config_path))

    def _check_options(self, config_path: str, config: DictConfig) -> None:
        """Raise ConfigCompositionException, with the file, for an unknown option in its defaults list."""
        entries: Any = OmegaConf.to_container(config["defaults"], resolve=False) if "defaults" in config else []
        for group, option in (item for entry in entries if isinstance(entry, dict) for item in entry.items()):
            name = f"{group.split()[-1].partition('@')[0].lstrip('/')}/{option}"
            fixed = isinstance(option, str) and "$" not in option and name.partition("/")[0] in options.GROUPS
            if fixed and self._find(name) is None:
                raise ConfigCompositionException(f"In '{config_path}': Could not find '{name}'")

    def _chosen_settings(self, experiment: str, chosen: set[str]) -> DictConfig:
        """Return the settings of the chosen components, each `group.option`, of an experiment and its base experiments.

        An experiment's settings override those of its bases, and those of paper.literal override all. Raises
        ConfigCompositionException for paper=literal and an experiment that is in none of the papers.
        """
        settings, merged = dict(self._settings(experiment)), OmegaConf.create({})
        if LITERAL in chosen and LITERAL not in settings.get(experiment, {}):
            raise ConfigCompositionException(f"paper=literal: experiment={experiment} is in none of the papers")
        layers = list(settings.items())
        layers += [(name, layer.get(LITERAL, {})) for name, layer in layers] if LITERAL in chosen else []
        for name, layer in layers:
            source = f"In 'experiment/{name}': {IF_CHOSEN}:"
            for place, keys in ((str(place), keys) for place, keys in layer.items()):
                group, _, option = place.partition(".")
                unknown = group not in options.GROUPS or self._find(f"{group}/{option}") is None
                if unknown and place not in (LITERAL, STUDY):
                    raise ConfigCompositionException(f"{source} there is no component {place}")
                if not isinstance(keys, DictConfig):
                    raise ConfigCompositionException(f"{source} {place}: expected keys and values, found {keys}")
                if place == STUDY or (place != LITERAL and place in chosen):
                    merged.merge_with({group: keys})
        return merged

    def _settings(self, experiment: str) -> Iterator[tuple[str, DictConfig]]:
        """Yield the names and IF_CHOSEN settings of an experiment's base experiments, then its own."""
        if path := self._find(f"experiment/{experiment}"):  # else Hydra raises the error
            content = _parsed(_text(path), str(path))
            for base in content.get("defaults", ()):
                if isinstance(base, str) and base != "_self_":
                    yield from self._settings(base)
            yield experiment, content.get(IF_CHOSEN) or OmegaConf.create({})


class _ComponentSearchPath(SearchPathPlugin):
    """Replaces the workbench's folder of options by those of all packages in Hydra's search path."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add packages that were allowed since Hydra last started; called by Hydra."""
        for element in search_path.get_path():
            if element.path == f"pkg://{options.OURS}.conf":
                element.path = f"{ComponentSource.scheme()}://{','.join(options.folders())}"


def _text(path: Path) -> str:
    try:
        return read_text(path, MAX_CONFIG)
    except InputError as error:
        raise ConfigCompositionException(str(error)) from None


@lru_cache(maxsize=512)
def _parsed(text: str, file: str) -> DictConfig:
    """Return parsed YAML, cached for all configurations of a process; callers must not change the result.

    Raises ConfigCompositionException, with the file, for anything but a mapping, and for wrong types of its keys.
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
    """Return a file's typed content without its IF_CHOSEN settings, cached; callers must not change the result.

    _packages: the allowed packages, on which the result depends.
    """
    plain: Any = OmegaConf.to_container(_parsed(text, file))
    plain.pop(IF_CHOSEN, None)
    return OmegaConf.create(typed(plain, file))


def typed(value: Any, file: str) -> Any:
    """Return the value with every mapping that has a `_target_` merged over the schema of that class.

    value: plain mappings and lists. Raises ConfigCompositionException, with the file, for an unknown key or a value of
    a wrong type.
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
        allowed = [str(key) for key in schema]  # `in` would not find keys without a default
        if unknown := [str(key) for key in config if key not in allowed]:
            keys = ", ".join(key for key in allowed if key != "_target_") or "none"
            raise InputError(f"{config['_target_']} has no key {unknown[0]!r}; it has {keys}")
        merged: Any = OmegaConf.merge(schema, config)
        with open_dict(merged):
            merged.update(defaults)
        return merged
    except (InputError, OmegaConfBaseException) as error:
        raise ConfigCompositionException(f"{file}: {' '.join(str(error).split())}") from error


def check_recorded(settings: Mapping[str, Any]) -> None:
    """Raise InputError, with the key, for a recorded configuration with unknown keys or values of another type.

    A recorded configuration has the keys of RunSchema, except for those of a sweep, and its components have values for
    the configuration keys of their classes. The targets must be allowed; their modules are imported.
    """
    expected = [item.name for item in fields(RunSchema) if item.name != "sweep"]
    if unknown := [key for key in settings if key not in expected]:
        raise InputError(f"{unknown[0]}: a recorded configuration has no such key; it has {', '.join(expected)}")
    for key in settings.keys() - set(options.GROUPS):
        try:
            OmegaConf.merge(OmegaConf.structured(RunSchema), {key: settings[key]})
        except OmegaConfBaseException as error:
            raise InputError(f"{error.full_key or key}: {str(error.msg).splitlines()[0]}") from None
    for group in options.GROUPS:
        if settings.get(group) is not None:
            check_component(settings[group], group)
