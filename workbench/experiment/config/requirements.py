"""Check that the chosen components have their required values, data, and capabilities of one another.

The check reads the configuration and the traits of the components' classes, before anything is built.
"""

import inspect
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.core.capabilities import ESTIMATED_CAMERA, EVIDENCE, IMAGES, KEYPOINTS, POINTS, START, Traits
from workbench.core.side_information import (
    CAMERA_CALIBRATION,
    FIRST_FRAMES,
    INITIAL_ANNOTATIONS,
    INITIAL_POSE,
    LIMB_RADII,
    ORDER,
    TRAJECTORY,
)
from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import GROUPS, options
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError

SOURCES: Mapping[str, str] = MappingProxyType(
    {
        "sports2d_walk": "the demonstration video of Sports2D, https://github.com/davidpagnon/Sports2D",
        "pose2sim_balance": "the demonstration videos of Pose2Sim, https://github.com/perfanalytics/pose2sim",
        "humaneva": "HumanEva I or II, http://humaneva.is.tue.mpg.de (or set dataset.folder)",
        "cmu": "clips of the CMU motion capture database, http://mocap.cs.cmu.edu",
        "bandai": "the motion dataset https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset",
    }
)
"""Origin of the folders in paths.data."""

_INTERACTING = ("dataset", "prior", "likelihood", "inference")
"""Groups with requirements on each other."""

_WITH_CAMERA = frozenset({IMAGES, KEYPOINTS, POINTS})
"""Observations that require a calibration, which also places points in the world."""
_WITH_SURFACE = frozenset({IMAGES, POINTS})
"""Observations of the person's surface, not of the joints alone."""

PAIRS = (
    ("inference", "prior"), ("inference", "likelihood"), ("inference", "dataset"),
    ("likelihood", "dataset"), ("prior", "dataset"),
)  # fmt: skip
"""Pairs of groups: the first has requirements on the second."""


def check_requirements(config: DictConfig, names: Mapping[str, str]) -> None:
    """Raise InputError with the first unmet requirement of a configuration that tracks.

    names: the chosen options, by group; a message names the class of a missing one.
    """
    for group in ("dataset", "body", "inference"):
        if config[group] is None:
            raise InputError(f"config: {group} is null; a run that tracks needs one: choose an option: {group}=NAME")
    if message := first_missing(config, names) or first_conflict(config, names):
        raise InputError(message)


def first_missing(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return a message on the first key without a value or missing recording, or None.

    names: the chosen options, by group.
    """
    plain: Any = OmegaConf.to_container(config, resolve=True)
    data = str((plain.get("paths") or {}).get("data") or "")
    for group in GROUPS:
        node = plain.get(group)
        if not isinstance(node, Mapping) or "_target_" not in node:
            continue
        if keys := [key for key in _required(node) if node.get(key, "???") in ("???", {})]:
            notes = options(group)[names[group]].notes if names.get(group) in options(group) else {}
            overrides = " ".join(f"{group}.{key}=…" for key in keys)
            meaning = "; ".join(f"{key}: {notes[key]}" for key in keys if key in notes)
            name = f"{group}={names[group]}" if group in names else str(node["_target_"])
            return f"config: {name} requires {', '.join(keys)}: add {overrides}" + (f" ({meaning})" if meaning else "")
        for key, value in leaves(node, group):
            if isinstance(value, str) and (message := _missing_recording(key, value, data)):
                return message
    return None


def _required(node: Mapping[str, Any]) -> Iterator[str]:
    """Return the keys of a component that have no default."""
    keys = config_keys(import_target(str(node["_target_"])))
    return (key for key, (_, default) in keys.items() if default is inspect.Parameter.empty)


def _missing_recording(key: str, value: str, data: str) -> str | None:
    """Return a message on a recording in a missing folder, or None; data: paths.data, empty if unset."""
    folder = value.removeprefix("None/" if value.startswith("None/") else f"{data}/").split("/")[0]
    source = SOURCES.get(folder, "")
    if value.startswith("None/"):
        return (
            f"config: {key} is a recording, and paths.data is not set: add paths.data=FOLDER or set "
            f"WORKBENCH_DATA=FOLDER; the folder must contain {folder}/{source and f', {source}'}"
        )
    if data and value.startswith(f"{data}/") and not Path(data, folder).exists():
        return f"config: {key}: {value} does not exist; paths.data must contain {folder}/{source and f': {source}'}"
    return None


def first_conflict(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return a message on the first unmet requirement between the chosen components, or None.

    names: the chosen options, by group.
    """
    traits, labels = _chosen(config, _INTERACTING, names)
    for group, component in reversed(traits.items()):
        if component.missing:
            return f"config: {labels[group]}: {component.missing}"
        for other, words in component.requires.items():
            if other not in _INTERACTING or (other not in traits and group == "dataset"):
                continue  # a dataset constrains the other components and requires none
            if other not in traits:
                return f"config: {labels[group]} requires a {other}, and none is chosen"
            for word in sorted(words - traits[other].provides):
                return f"config: {labels[group]} requires {word} of the {other}, which {labels[other]} does not provide"
    provided = traits["dataset"].provides if "dataset" in traits else frozenset()
    evaluated = traits["likelihood"].requires.get("dataset", frozenset()) if "likelihood" in traits else frozenset()
    for group, component in traits.items():
        for word in sorted(component.requires.get("excluded", frozenset()) & provided):
            return f"config: {labels[group]} does not work with {word}, which {labels['dataset']} provides"
    for group, component in traits.items():
        for word in sorted(component.requires.get("conflicting_observations", frozenset()) & evaluated):
            return f"config: {labels[group]} starts from {word}, which {labels['likelihood']} would use a second time"
    return None


def ignores_likelihood(config: DictConfig) -> bool:
    """Return whether a likelihood is chosen that the inference does not require."""
    declared = _declared(config.inference)
    return config.get("likelihood") is not None and declared is not None and "likelihood" not in declared.requires


def evidence_problem(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return why the log evidence cannot be compared between runs, or None if it can.

    A likelihood that is averaged, tempered, weighted or built from the run's own estimates is no density of the data.
    """
    if config.get("likelihood") is None or ignores_likelihood(config):
        return "there is no likelihood"
    if EVIDENCE in traits_of(config.likelihood).provides:
        return None
    return f"{_name_of(config, 'likelihood', names)} is not {EVIDENCE}"


def assumptions(config: DictConfig) -> list[str]:
    """Return the side information that a run uses, in the order of `ORDER`; a study uses none."""
    traits, _ = _chosen(config, ("body", *_INTERACTING) if config.get("inference") is not None else (), {})
    provided = traits["dataset"].provides if "dataset" in traits else frozenset()
    observed = frozenset().union(*(component.requires.get("dataset", ()) for component in traits.values()))
    words = {CAMERA_CALIBRATION} if _WITH_CAMERA & observed and ESTIMATED_CAMERA not in provided else set()
    for component in traits.values():
        words |= component.requires.get("assumptions", frozenset()) | (
            component.requires.get("optional_assumptions", frozenset()) & provided
        )
    if "inference" in traits and TRAJECTORY not in words:  # a trajectory includes the first pose
        words |= _start(provided, traits["inference"])
    unused = set() if _WITH_SURFACE & observed else {LIMB_RADII}
    return [word for word in ORDER if word in words - unused]


def _start(provided: frozenset[str], inference: Traits) -> set[str]:
    """Return the side information that initializes an inference, see `inference.initialization.poses`."""
    if INITIAL_POSE in provided:
        return {INITIAL_POSE}
    if INITIAL_ANNOTATIONS in provided:
        return {INITIAL_ANNOTATIONS, CAMERA_CALIBRATION}
    return {FIRST_FRAMES} if START in inference.requires.get("dataset", frozenset()) else set()


def _chosen(
    config: DictConfig, groups: tuple[str, ...], names: Mapping[str, str]
) -> tuple[dict[str, Traits], dict[str, str]]:
    """Return the traits and the labels of the components that are used, by group."""
    groups = tuple(group for group in groups if config.get(group) is not None)
    chosen = [group for group in groups if group != "likelihood" or not ignores_likelihood(config)]
    return {group: traits_of(config[group]) for group in chosen}, {g: _name_of(config, g, names) for g in chosen}


def traits_of(node: DictConfig) -> Traits:
    """Return the traits of a node's class; nested components count with their own traits."""
    return _declared(node) or Traits()


def _declared(node: DictConfig) -> Traits | None:
    declared = getattr(import_target(str(node["_target_"])), "traits", None)
    if declared is None or isinstance(declared, Traits):
        return declared
    traits: Traits = declared({str(key): _value(node, key) for key in node if key != "_target_"})
    return traits


def _value(node: DictConfig, key: Any) -> Any:
    """Return a key's value, or the traits of a nested component; None for a missing or unresolvable value."""
    try:
        value = None if OmegaConf.is_missing(node, key) else node[key]
    except OmegaConfBaseException:  # building the component reports it
        return None
    if not isinstance(value, DictConfig):
        return value
    return traits_of(value) if "_target_" in value else {str(name): _value(value, name) for name in value}


def _name_of(config: DictConfig, group: str, names: Mapping[str, str]) -> str:
    return f"{group}={names.get(group) or str(config[group]['_target_']).rpartition('.')[2]}"


def table(traits: Mapping[str, Mapping[str, Traits]]) -> dict[str, dict[str, str]]:
    """Return for each pair of groups and option of the first group the incompatible options of the second and why.

    traits: traits of the options, by group and name.
    """
    return {
        f"{first} with {second}": {
            name: _compatibility(component, second, traits[second]) for name, component in traits[first].items()
        }
        for first, second in PAIRS
    }


def _compatibility(component: Traits, group: str, others: Mapping[str, Traits]) -> str:
    if component.missing:
        return f"works with another nested component: {component.missing}"
    reasons = []
    for word in sorted(component.requires.get(group, ())):
        without = [name for name, other in others.items() if word not in other.provides]
        reasons += [f"requires {word}: not with {', '.join(without)}"] if without else []
    return "; ".join(reasons) or ("all" if group in component.requires else f"all; requires nothing of the {group}")
