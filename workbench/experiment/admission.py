"""What a composed configuration may say, Hydra's own part included: checked before Hydra acts on any of it.

A folder of options given by `--config-dir`, or a YAML that was copied, may come from a stranger. Hydra would call what
callbacks, launchers, sweepers and logging name, set environment variables, and write where its folders say. So every
name is one of those listed here, and what says a command, a variable or a folder outside the current one stands on the
command line.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import hydra._internal.hydra as hydra_main
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.core_plugins import file_config_source as files_of_hydra
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from workbench.errors import InputError
from workbench.experiment.build import check_names, targets_in
from workbench.experiment.parts import GROUPS
from workbench.limits import MOST_CONFIG, check_file, check_yaml

CALLBACKS = {"watch": {"_target_": "workbench.sweep.progress.Watch"}}
CACHES = ("~/.cache/workbench", None)
"""Beside $WORKBENCH_CACHE, the folders for what can be made again that need not be said."""

_BY_WORD = (
    "hydra.job.env_set", "hydra.job.env_copy", "hydra.searchpath", "hydra.launcher.setup",
    "hydra.launcher.additional_parameters", "hydra.launcher.submitit_folder", "hydra.launcher.temp_folder",
    "hydra.launcher.pre_dispatch", "hydra.sweeper.storage", "hydra.sweeper.custom_search_space",
)  # fmt: skip
"""Keys that run commands, set variables or write elsewhere: but for what is Hydra's own default, said or empty."""

_FOLDERS = {"hydra.run.dir": "hydra.run.dir", "hydra.sweep.dir": "sweep.resume"}
"""Keys of the folders written to, each with a key that says it as well."""

_RUN = "hydra.mode=RUN"

_PLAIN = re.compile(r"[\w.,:@%*+-]*")
_LOG_FILES = ("${hydra.runtime.output_dir}/${hydra.job.name}.log", "hydra-${hydra.job.name}.log")
_LOG_KEYS = {
    "formatters": {"format", "datefmt", "style"}, "loggers": {"level", "handlers", "propagate"},
    "handlers": {"class", "formatter", "level", "stream", "filename", "mode", "encoding", "delay"},
}  # fmt: skip


class CheckedLoader(ConfigLoaderImpl):
    """Hydra's loader of configurations, which lets none through that `check_composed` refuses.

    Hydra composes twice, the first time only to see whether the configuration says that there is to be a sweep. Unless
    the command line does, that is the run's own composition, kept for the second time, or the error that it ends with.
    """

    _kept: tuple[tuple[str | None, list[str]], DictConfig | Exception] | None = None

    def load_configuration(
        self, config_name: str | None, overrides: list[str], run_mode: RunMode, from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:  # fmt: skip
        """Compose, as Hydra does. Raises InputError for what is nonsense or not allowed, HydraException as Hydra."""
        if run_mode == RunMode.MULTIRUN and not validate_sweep_overrides and _is_of_one_run(overrides):
            self._kept = (config_name, [*overrides]), self._tried(config_name, overrides, from_shell)
            return self._taken()
        said = overrides[:-1] if overrides[-1:] == [_RUN] else overrides  # which Hydra adds
        if run_mode == RunMode.RUN and self._kept is not None and self._kept[0] == (config_name, said):
            config, self._kept = self._taken(), None
            config.hydra.mode = RunMode.RUN
            config.hydra.overrides.hydra.extend(overrides[len(said) :])
            return config
        return self._checked(config_name, overrides, run_mode, from_shell, validate_sweep_overrides)

    def _tried(self, config_name: str | None, overrides: list[str], from_shell: bool) -> DictConfig | Exception:
        try:
            return self._checked(config_name, overrides, RunMode.RUN, from_shell, True)
        except Exception as error:  # noqa: BLE001 (whatever it is, whoever asks for the configuration raises it)
            return error

    def _taken(self) -> DictConfig:
        assert self._kept is not None
        if isinstance(self._kept[1], Exception):
            raise self._kept[1]
        return self._kept[1]

    def _checked(
        self, config_name: str | None, overrides: list[str], run_mode: RunMode, from_shell: bool, validate: bool
    ) -> DictConfig:
        try:
            config = super().load_configuration(config_name, overrides, run_mode, from_shell, validate)
            check_composed(config, overrides)
        except (InputError, HydraException, OmegaConfBaseException):
            raise
        except (AssertionError, AttributeError, LookupError, OSError, RecursionError, TypeError, ValueError) as error:
            told = "levels without end" if isinstance(error, RecursionError) else f"{type(error).__name__}: {error}"
            raise InputError(f"config: expected a configuration that can be composed, found {told}") from error
        return config

    def _process_config_searchpath(self, config_name: str | None, parsed_overrides: Any, repo: Any) -> None:
        """Refuse places to look in before anything is looked for there: a package would be imported."""
        loaded = None if config_name is None else repo.load_config(config_path=config_name)
        places = OmegaConf.select(loaded.config, "hydra.searchpath") if loaded is not None else None
        if places and not any(each.get_key_element() == "hydra.searchpath" for each in parsed_overrides):
            _refuse("hydra.searchpath", places)
        super()._process_config_searchpath(config_name, parsed_overrides, repo)


class FileConfigSource(files_of_hydra.FileConfigSource):
    """Files of a folder that a person named, which may be a stranger's: plain YAML of bounded size."""

    def load_config(self, config_path: str) -> ConfigResult:
        """Load the file; raises InputError for anything but plain YAML."""
        path = Path(self.path, self._normalize_file_name(config_path))
        if path.exists():
            check_file(path, MOST_CONFIG)
            try:
                check_yaml(path, path.read_text(encoding="utf-8"))
                return super().load_config(config_path)
            except InputError:
                raise
            except (YAMLError, OmegaConfBaseException, ValueError, TypeError, RecursionError) as error:
                raise InputError(f"{path}: expected a configuration: {' '.join(str(error).split())}") from None
        return super().load_config(config_path)


def admit_checked_only() -> None:
    """Have Hydra, wherever it is started from in this process, compose through `CheckedLoader`."""
    hydra_main.ConfigLoaderImpl = CheckedLoader  # type: ignore[attr-defined]
    # every composition copies it whole, and again each of its nodes that it takes
    ConfigStore.__deepcopy__ = lambda self, _: self  # type: ignore[attr-defined]
    SourcesRegistry.instance().types[FileConfigSource.scheme()] = FileConfigSource


def check_composed(config: DictConfig, overrides: Sequence[str]) -> None:
    """Refuse a composed configuration that names what is not allowed, or says what only the command line may.

    overrides: the command line's. Raises InputError with the place and what was found there. Nothing is imported.
    """
    said = _said(overrides)
    check_names({place: name for group in GROUPS for place, name in _names_in(config, group).items()})
    hydra = config.hydra
    if len(hydra.overrides.hydra) + len(hydra.overrides.task) != len(overrides):
        _refuse("hydra.overrides", [*hydra.overrides.hydra, *hydra.overrides.task])
    leaves = dict(_leaves(hydra, "hydra"))
    _check_names(leaves)
    _check_words(leaves, said)
    for kind in ("hydra_logging", "job_logging"):
        _check_logging(f"hydra.{kind}", OmegaConf.to_container(hydra)[kind])  # type: ignore[call-overload,index]
    for key, other in _FOLDERS.items():
        folder = OmegaConf.select(config, key)
        _check_folder(key, folder, key in said or str(folder) == said.get(other))
    _check_caches(config, said)


def _is_of_one_run(overrides: Sequence[str]) -> bool:
    """Tell that overrides are understood, none has several values, and none says that there is a sweep."""
    try:
        parsed = OverridesParser.create().parse_overrides([*overrides])
    except HydraException:
        return False
    return not any(each.is_sweep_override() or each.key_or_group in ("hydra", "hydra.mode") for each in parsed)


def _refuse(place: str, found: object) -> None:
    raise InputError(f"config: {place}: {found!r} is not allowed in a file; if it is meant, say {place}=…")


def _said(overrides: Sequence[str]) -> dict[str, Any]:
    """Collect what the command line says of keys, each value in a mapping by its own key."""
    found: dict[str, Any] = {}
    for each in OverridesParser.create().parse_overrides(list(overrides)):
        key, value = each.key_or_group, None if each.is_sweep_override() else each.value()
        found[key] = value
        if isinstance(value, Mapping):
            found |= dict(_leaves(OmegaConf.create(dict(value)), key))
    return found


def _leaves(node: Any, place: str) -> Iterator[tuple[str, Any]]:
    """Give every value that is no mapping as it is written, lists as a whole, by its place."""
    if not isinstance(node, DictConfig) or node._is_none() or node._is_missing() or node._is_interpolation():
        plain = OmegaConf.to_container(node) if OmegaConf.is_list(node) else node
        yield place, plain._value() if isinstance(plain, DictConfig) else plain
        return
    for key in map(str, node):
        inner: Any = node._get_node(key)
        container = isinstance(inner, DictConfig) or OmegaConf.is_list(inner)
        yield from _leaves(inner if container else inner._value(), f"{place}.{key}")


def _names_in(config: DictConfig, group: str) -> dict[str, Any]:
    """Collect by place what a part names, and parts nested in it; raises InputError for what is no mapping."""
    node = config._get_node(group) if group in config else None
    if node is None or (isinstance(node, DictConfig) and (node._is_none() or node._is_missing())):
        return {}
    if not isinstance(node, DictConfig):
        value = node._value()
        if value is not None:
            raise InputError(f"config: {group}: expected a part with a _target_, found {value!r}")
        return {}
    found = targets_in(OmegaConf.to_container(node), group)
    return {place: OmegaConf.select(config, place) if "${" in str(each) else each for place, each in found.items()}


def _check_names(leaves: Mapping[str, Any]) -> None:
    """Refuse callbacks, launchers, sweepers and samplers that are not known, and names anywhere else."""
    known = {
        "hydra.callbacks.watch._target_": {CALLBACKS["watch"]["_target_"]},
        **{f"hydra.{kind}._target_": _stored(kind) for kind in ("launcher", "sweeper", "sweeper/sampler")},
    }
    known = {place.replace("/", "."): names for place, names in known.items()}
    for place, value in leaves.items():
        if place.startswith("hydra.callbacks.") and place not in known:
            raise InputError(f"config: {place}: only the callback watch is known, found {value!r}")
        special = re.search(r"\._\w+_(\.|$)", place)
        if place in known and value not in known[place]:
            raise InputError(f"config: {place} must be one of {', '.join(sorted(known[place]))}, refused {value!r}")
        if special and place not in known and (place, value) != ("hydra.sweeper.sampler._partial_", True):
            raise InputError(f"config: {place}: expected no such key, refused {value!r}")


def _stored(kind: str) -> set[str]:
    """The classes of the launchers, sweepers or samplers that are installed; none where there is no such plugin."""
    try:
        names = ConfigStore.instance().list(f"hydra/{kind}")
    except OSError:  # as Hydra says of a group without options
        names = []
    return {_class_of(f"hydra/{kind}/{name}") for name in names if name.endswith(".yaml")}


@cache
def _class_of(option: str) -> str:
    """What an option builds that a plugin of Hydra stored when it was loaded."""
    return str(ConfigStore.instance().load(option).node.get("_target_"))


def _check_words(leaves: Mapping[str, Any], said: Mapping[str, Any]) -> None:
    """Refuse what runs commands, sets variables or leads elsewhere and was not said; and texts that may do so."""
    usual = _usual(str(leaves.get("hydra.launcher._target_")))
    for place, value in leaves.items():
        allowed = value in (None, {}, []) or place in said or usual.get(place, ...) == value
        if any(f"{place}.".startswith(f"{key}.") for key in _BY_WORD) and not allowed:
            _refuse(place, value)
        if place.startswith("hydra.sweeper.params."):
            key = place.removeprefix("hydra.sweeper.params.").lstrip("+~")
            if re.match(r"(hydra|parts|paths|sweep)\b", key) or re.search(r"(^|\.)cache$", key):
                _refuse(place, value)
        elif place.startswith(("hydra.launcher.", "hydra.sweeper.")):
            text = isinstance(value, str | list | dict) and not (isinstance(value, str) and _PLAIN.fullmatch(value))
            if text and not allowed:
                _refuse(place, value)
    for place, words in {"hydra.output_subdir": (None, ".hydra"), "hydra.job.chdir": (None, False)}.items():
        if leaves.get(place) not in words and place not in said:
            _refuse(place, leaves.get(place))
    if not re.fullmatch(r"[\w.-]{1,100}", str(leaves.get("hydra.job.name"))):
        raise InputError(f"config: hydra.job.name: expected a plain name, found {leaves.get('hydra.job.name')!r}")


def _usual(launcher: str) -> dict[str, Any]:
    """What the launcher's own options are, by place."""
    store = ConfigStore.instance()
    for name in store.list("hydra/launcher"):
        node = store.load(f"hydra/launcher/{name}").node if name.endswith(".yaml") else {}
        if node.get("_target_") == launcher:
            return dict(_leaves(node, "hydra.launcher"))
    return {}


def _check_logging(place: str, said: Any) -> None:
    """Lines for the terminal and for the run's own file, plainly formatted; whatever else can be called is refused."""
    if said is None:
        return
    if not isinstance(said, dict):
        raise InputError(f"config: {place}: expected a mapping, found {said!r}")
    known = {"version", "root", "disable_existing_loggers", *_LOG_KEYS}
    rooms = [(f"{place}.{room}.{name}", each, keys) for room, keys in _LOG_KEYS.items()
             for name, each in (said.get(room) or {}).items()]  # fmt: skip
    rooms += [(place, said, known), (f"{place}.root", said.get("root") or {}, _LOG_KEYS["loggers"])]
    for here, keys, allowed in rooms:
        if unknown := [key for key in keys if key not in allowed]:
            raise InputError(f"config: {here}: expected {', '.join(sorted(allowed))}, refused {unknown[0]!r}")
    for name, handler in (said.get("handlers") or {}).items():
        expected = {
            "class": ("logging.StreamHandler", "logging.FileHandler"),
            "stream": (None, "ext://sys.stdout", "ext://sys.stderr"), "filename": (None, *_LOG_FILES),
        }  # fmt: skip
        for key, words in expected.items():
            if handler.get(key) not in words:
                told = " or ".join(str(word) for word in words if word)
                raise InputError(f"config: {place}.handlers.{name}.{key}: expected {told}, found {handler.get(key)!r}")
    if re.search(r"'(ext|cfg)://(?!sys\.std(out|err)')", repr(said)):
        raise InputError(f"config: {place}: expected no objects but sys.stdout and sys.stderr, found others")


def _check_folder(place: str, value: object, said: bool) -> None:
    """A folder to write to lies in the current one, or was said; and can be one."""
    if value is None:
        return
    path = Path(os.path.normpath(Path(str(value)).expanduser()))
    if not said and ((path.is_absolute() and not path.is_relative_to(Path.cwd())) or ".." in path.parts):
        _refuse(place, str(value))
    try:
        found = next(each for each in (path, *path.parents) if each.exists())
        if not found.is_dir():
            raise InputError(f"{place}: expected a folder, found the file {found}")
        if found != path and place in _FOLDERS:
            with TemporaryDirectory(dir=found, prefix="."):  # Hydra makes the folder, and would end in a traceback
                pass
    except OSError as error:
        raise InputError(f"{place}: cannot be a folder: {error.strerror}: {path}") from None


def _check_caches(config: DictConfig, said: Mapping[str, Any]) -> None:
    """Every folder for what can be made again is the person's own, lies in the current one, or was said."""
    own = {os.environ.get("WORKBENCH_CACHE"), *CACHES}
    top = OmegaConf.select(config, "paths.cache", throw_on_missing=False)
    if top not in own:
        _check_folder("paths.cache", top, "paths.cache" in said)
    for group in GROUPS:
        for place, value in _leaves(config._get_node(group), group) if group in config else ():
            named = place.endswith(".cache") and value not in (None, "${paths.cache}")
            if named and (found := OmegaConf.select(config, place)) not in (top, *own):
                _check_folder(place, found, place in said)
