"""Hydra's way to the options of all packages: each is merged over its class's schema when it is loaded."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.errors import ConfigCompositionException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.experiment import parts
from workbench.experiment.schema import schema_of_target

WHEN = "when"
"""Group of the options that are made up here, and key of an experiment's file: what it sets of particular parts."""


class PartsConfigSource(ConfigSource):
    """The folders `conf/` of the packages in `parts://PACKAGE,PACKAGE,…`, looked through in this order.

    An option `when/EXPERIMENT,group=option,group=option,…` is what the experiment sets of the parts chosen:

        when:
          prior.jitter: {sigma: 0.01}

    in its own file, or in that of an experiment it begins with, holds where the prior is jitter, and only there.
    """

    @staticmethod
    def scheme() -> str:
        """Tell what its places begin with."""
        return "parts"

    def available(self) -> bool:
        """Tell whether it leads anywhere; names are looked up when they are given."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Tell whether a package has this folder."""
        return any((folder / config_path).is_dir() for folder in self._folders())

    def is_config(self, config_path: str) -> bool:
        """Tell whether a package has this file, or it is one of those made up here."""
        return config_path.startswith(f"{WHEN}/") or self._find(config_path) is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Names of the groups and options in a folder; those that begin with an underscore are not for choosing."""
        found = [path for folder in self._folders() for path in (folder / config_path).glob("[!_]*")]
        groups = {path.name for path in found if path.is_dir() and results_filter is not ObjectType.CONFIG}
        files = {path.stem for path in found if path.suffix == ".yaml" and results_filter is not ObjectType.GROUP}
        return sorted(groups | files)

    def load_config(self, config_path: str) -> ConfigResult:
        """The option, typed. Raises ConfigCompositionException for a key that its class does not know, naming both."""
        if config_path.startswith(f"{WHEN}/"):
            experiment, *chosen = config_path.removeprefix(f"{WHEN}/").removesuffix(".yaml").split(",")
            return self._result(self._settings(experiment, set(chosen)), {"package": "_global_"})
        path = self._find(config_path)
        assert path is not None
        text = path.read_text(encoding="utf-8")
        loaded: Any = OmegaConf.create(text)
        if config_path.startswith("experiment/") and WHEN in loaded:
            del loaded[WHEN]
        return self._result(typed(loaded, str(path)), ConfigSource._get_header_dict(text))

    def _result(self, config: Any, header: dict[str, str | None]) -> ConfigResult:
        return ConfigResult(provider=self.provider, path=self.full_path(), config=config, header=header)

    def _folders(self) -> Iterator[Path]:
        return map(parts.folder, self.path.split(","))

    def _find(self, config_path: str) -> Path | None:
        name = self._normalize_file_name(config_path)
        return next((folder / name for folder in self._folders() if (folder / name).is_file()), None)

    def _settings(self, experiment: str, chosen: set[str]) -> DictConfig:
        """What an experiment and those it begins with set of the parts chosen, each `group.option`; its own last."""
        found = OmegaConf.create({})
        path = self._find(f"experiment/{experiment}")
        if path is None:
            return found
        own: Any = OmegaConf.create(path.read_text(encoding="utf-8"))
        for base in own.get("defaults", ()):
            if isinstance(base, str) and base != "_self_":
                found.merge_with(self._settings(base, chosen))
        for place, keys in own.get(WHEN, {}).items():
            group, _, option = str(place).partition(".")
            if group not in parts.GROUPS or self._find(f"{group}/{option}") is None:
                raise ConfigCompositionException(f"{path}: {WHEN}: there is no part {place}")
            if place in chosen:
                found.merge_with({group: keys})
        return found


class PartsSearchPath(SearchPathPlugin):
    """Puts the options of all packages where Hydra would look for ours alone."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Called by Hydra whenever it is started, so that packages named since then are found too."""
        for element in search_path.get_path():
            if element.path == f"pkg://{parts.OURS}.conf":
                element.path = f"{PartsConfigSource.scheme()}://{','.join(parts.packages())}"


def typed(config: Any, file: str) -> Any:
    """Merge every mapping that names a class over the schema of that class, so that its keys are checked.

    Raises ConfigCompositionException, naming the file, for a key that is none or a value of another type.
    """
    for key in list(config.keys()) if isinstance(config, DictConfig) else range(len(config)):
        node = config._get_node(key)
        if key == "hydra" or not isinstance(node, DictConfig | ListConfig):  # Hydra looks after its own
            continue
        if not (node._is_none() or node._is_interpolation()):
            config._set_item_impl(key, typed(node, file))
    if not isinstance(config, DictConfig) or "_target_" not in config:
        return config
    schema = OmegaConf.structured(schema_of_target(config._target_, file, "defaults" in config))
    known = [str(key) for key in schema]  # which `in` would not find where they have no default
    if unknown := [str(key) for key in config if key not in known]:
        keys = ", ".join(key for key in known if key not in ("_target_", "defaults")) or "none"
        raise ConfigCompositionException(f"{file}: {config._target_} has no key {unknown[0]!r}; it has {keys}")
    try:
        return OmegaConf.merge(schema, config)
    except OmegaConfBaseException as error:
        raise ConfigCompositionException(f"{file}: {' '.join(str(error).split())}") from error
