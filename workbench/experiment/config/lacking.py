"""What a configuration leaves out: keys without a value, and recordings that nobody has said the place of."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import keys_without_default

SOURCES: Mapping[str, str] = MappingProxyType(
    {
        "sports2d_walk": "the demonstration video of Sports2D, https://github.com/davidpagnon/Sports2D",
        "pose2sim_balance": "the demonstration videos of Pose2Sim, https://github.com/perfanalytics/pose2sim",
        "cmu": "clips of the CMU motion capture database, http://mocap.cs.cmu.edu",
        "bandai": "the motion dataset https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset",
    }
)
"""Where the folders of paths.data come from."""


def what_lacks(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Say what the parts of a configuration need and nobody has said, in one sentence; None where nothing lacks.

    names: the options chosen, by group.
    """
    for group in GROUPS:
        node = config.get(group)
        if not isinstance(node, DictConfig) or "_target_" not in node:
            continue
        if keys := _without_value(node):
            notes = options(group)[names[group]].notes if names.get(group) in options(group) else {}
            said = " ".join(f"{group}.{key}=…" for key in keys)
            what = "; ".join(f"{key}: {notes[key]}" for key in keys if key in notes)
            called = f"{group}={names[group]}" if group in names else str(node["_target_"])
            return f"config: {called} needs {', '.join(keys)}: say {said}" + (f" ({what})" if what else "")
        for key, value in _texts(node, group):
            if value.startswith("None/"):
                folder = value.split("/")[1]
                source = f", {SOURCES[folder]}" if folder in SOURCES else ""
                return (
                    f"config: {key} is a recording, and paths.data is not set: say paths.data=FOLDER or set "
                    f"WORKBENCH_DATA=FOLDER, in which {folder}/ lies{source}"
                )
            if folder := _absent(value, str(OmegaConf.select(config, "paths.data") or "")):
                source = f": {SOURCES[folder]}" if folder in SOURCES else ""
                return f"config: {key}: there is no {value}; paths.data should hold {folder}/{source}"
    return None


def _absent(value: str, data: str) -> str:
    """Name the folder of `data` that a path is in, where there is no such folder."""
    if not data or not value.startswith(f"{data}/"):
        return ""
    folder = value.removeprefix(f"{data}/").split("/")[0]
    return "" if Path(data, folder).exists() else folder


def _without_value(node: DictConfig) -> list[str]:
    """Name the keys of a part that it must be given, and is not."""
    required = keys_without_default(str(node["_target_"]))
    return [key for key in required if key not in node or OmegaConf.is_missing(node, key) or _empty(node, key)]


def _empty(node: DictConfig, key: str) -> bool:
    """Tell a mapping in which nothing stands, such as `sources`."""
    value: Any = OmegaConf.to_container(node, resolve=False).get(key)  # type: ignore[union-attr]
    return isinstance(value, dict) and not value


def _texts(node: DictConfig, place: str) -> Iterator[tuple[str, str]]:
    """Find all texts of a part, by their place; what cannot be resolved is left to who builds it."""
    for name in node:
        key = str(name)
        try:
            value = None if OmegaConf.is_missing(node, key) else node[key]
        except OmegaConfBaseException:
            continue
        if isinstance(value, DictConfig):
            yield from _texts(value, f"{place}.{key}")
        elif isinstance(value, str):
            yield f"{place}.{key}", value
