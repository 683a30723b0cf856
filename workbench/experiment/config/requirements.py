"""Whether the chosen components have what they need: values, data, and capabilities of one another.

Everything is read from the configuration and the components' classes, before anything is built.
"""

import inspect
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.core.capabilities import EVIDENCE, IMAGES, KEYPOINTS, ONE_CAMERA, POINTS, START, Traits
from workbench.core.side_information import (
    CAMERA_CALIBRATION,
    FIRST_FRAMES,
    INITIAL_ANNOTATIONS,
    INITIAL_POSE,
    LIMB_RADII,
    ORDER,
    TRAJECTORY,
)
from workbench.experiment.config.instantiate import keys_of, resolved
from workbench.experiment.config.options import GROUPS, options
from workbench.recording.settings import leaves
from workbench.utils.errors import InputError

SOURCES: Mapping[str, str] = MappingProxyType(
    {
        "sports2d_walk": "the demonstration video of Sports2D, https://github.com/davidpagnon/Sports2D",
        "pose2sim_balance": "the demonstration videos of Pose2Sim, https://github.com/perfanalytics/pose2sim",
        "cmu": "clips of the CMU motion capture database, http://mocap.cs.cmu.edu",
        "bandai": "the motion dataset https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset",
    }
)
"""Origin of the folders in paths.data."""

_INTERACTING = ("dataset", "prior", "likelihood", "inference")
"""Groups that require something of each other."""

_WITH_CAMERA = frozenset({IMAGES, KEYPOINTS, ONE_CAMERA, POINTS})
"""Observations that only a known calibration can use; it also placed points in the world."""
_WITH_SURFACE = frozenset({IMAGES, POINTS})
"""Observations of the person's surface, not of the joints alone."""

PAIRS = (
    ("inference", "prior"), ("inference", "likelihood"), ("inference", "dataset"),
    ("likelihood", "dataset"), ("prior", "dataset"),
)  # fmt: skip
"""Groups of which the first needs something of the second."""


def check_requirements(config: DictConfig, names: Mapping[str, str]) -> None:
    """Raise InputError with the first unmet requirement of a configuration that tracks.

    names: the options chosen, by group; classes stand for those that are not given.
    """
    for group in ("dataset", "body", "inference"):
        if config[group] is None:
            raise InputError(f"config: {group} is null; a run that tracks needs one: choose an option, {group}=NAME")
    if sentence := first_missing(config, names) or first_conflict(config, names):
        raise InputError(sentence)


def first_missing(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return a sentence on the first key without a value or absent recording, None where nothing is missing.

    names: the options chosen, by group.
    """
    plain: Any = OmegaConf.to_container(config, resolve=True)
    data = str((plain.get("paths") or {}).get("data") or "")
    for group in GROUPS:
        node = plain.get(group)
        if not isinstance(node, Mapping) or "_target_" not in node:
            continue
        if keys := [key for key in _required(node) if node.get(key, "???") in ("???", {})]:
            notes = options(group)[names[group]].notes if names.get(group) in options(group) else {}
            said = " ".join(f"{group}.{key}=…" for key in keys)
            what = "; ".join(f"{key}: {notes[key]}" for key in keys if key in notes)
            called = f"{group}={names[group]}" if group in names else str(node["_target_"])
            return f"config: {called} needs {', '.join(keys)}: say {said}" + (f" ({what})" if what else "")
        for key, value in leaves(node, group):
            if isinstance(value, str) and (sentence := _absent(key, value, data)):
                return sentence
    return None


def _required(node: Mapping[str, Any]) -> Iterator[str]:
    """Return the keys of a component that have no default."""
    keys = keys_of(resolved(str(node["_target_"])))
    return (key for key, (_, default) in keys.items() if default is inspect.Parameter.empty)


def _absent(key: str, value: str, data: str) -> str | None:
    """Return a sentence on a recording in a folder that does not exist; data: paths.data, empty where it is not set."""
    folder = value.removeprefix("None/" if value.startswith("None/") else f"{data}/").split("/")[0]
    source = SOURCES.get(folder, "")
    if value.startswith("None/"):
        return (
            f"config: {key} is a recording, and paths.data is not set: say paths.data=FOLDER or set "
            f"WORKBENCH_DATA=FOLDER, in which {folder}/ lies{source and f', {source}'}"
        )
    if data and value.startswith(f"{data}/") and not Path(data, folder).exists():
        return f"config: {key}: there is no {value}; paths.data should hold {folder}/{source and f': {source}'}"
    return None


def first_conflict(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return a sentence on the first unmet requirement between the chosen components, None where they go together.

    names: the options chosen, by group.
    """
    traits, called = _chosen(config, _INTERACTING, names)
    for group, part in reversed(traits.items()):
        if part.missing:
            return f"config: {called[group]}: {part.missing}"
        for other, words in part.requires.items():
            if other not in _INTERACTING or (other not in traits and group == "dataset"):
                continue  # a dataset asks what the others are like, not that there are any
            if other not in traits:
                return f"config: {called[group]} needs a {other}, and there is none"
            for word in sorted(words - traits[other].provides):
                return f"config: {called[group]} needs {word} of the {other}, which {called[other]} does not have"
    shown = traits["dataset"].provides if "dataset" in traits else frozenset()
    weighed = traits["likelihood"].requires.get("dataset", frozenset()) if "likelihood" in traits else frozenset()
    for group, part in traits.items():
        for word in sorted(part.requires.get("excluded", frozenset()) & shown):
            return f"config: {called[group]} is not for {word}, which {called['dataset']} shows"
    for group, part in traits.items():
        for word in sorted(part.requires.get("conflicting_observations", frozenset()) & weighed):
            return f"config: {called[group]} starts from {word}, which {called['likelihood']} would use a second time"
    return None


def ignores_likelihood(config: DictConfig) -> bool:
    """Return whether a likelihood is chosen that the inference declares not to need."""
    declared = _declared(config.inference)
    return config.get("likelihood") is not None and declared is not None and "likelihood" not in declared.requires


def no_evidence(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Return why the likelihood's evidence cannot be compared between runs, None where it can.

    A likelihood that is averaged, flattened, weighted or made from the run's own estimates is no density of the data.
    """
    if config.get("likelihood") is None or ignores_likelihood(config):
        return "there is no likelihood"
    if EVIDENCE in traits_of(config.likelihood).provides:
        return None
    return f"{_name_of(config, 'likelihood', names)} is not {EVIDENCE}"


def assumptions(config: DictConfig) -> list[str]:
    """Return the side information that a run uses, in its `ORDER`; a study uses none."""
    traits, _ = _chosen(config, ("body", *_INTERACTING) if config.get("inference") is not None else (), {})
    offers = traits["dataset"].provides if "dataset" in traits else frozenset()
    shown = frozenset().union(*(part.requires.get("dataset", ()) for part in traits.values()))
    words = {CAMERA_CALIBRATION} if _WITH_CAMERA & shown else set()
    for part in traits.values():
        words |= part.requires.get("assumptions", frozenset()) | (
            part.requires.get("optional_assumptions", frozenset()) & offers
        )
    if "inference" in traits and TRAJECTORY not in words:  # which knows the first pose
        words |= _start(offers, traits["inference"])
    unused = set() if _WITH_SURFACE & shown else {LIMB_RADII}
    return [word for word in ORDER if word in words - unused]


def _start(offers: frozenset[str], inference: Traits) -> set[str]:
    """Return what an inference starts from, see `inference.initialization.poses`."""
    if INITIAL_POSE in offers:
        return {INITIAL_POSE}
    if INITIAL_ANNOTATIONS in offers:
        return {INITIAL_ANNOTATIONS, CAMERA_CALIBRATION}
    return {FIRST_FRAMES} if START in inference.requires.get("dataset", frozenset()) else set()


def _chosen(
    config: DictConfig, groups: tuple[str, ...], names: Mapping[str, str]
) -> tuple[dict[str, Traits], dict[str, str]]:
    """Return the traits and the names of the components that take part, by group."""
    groups = tuple(group for group in groups if config.get(group) is not None)
    chosen = [group for group in groups if group != "likelihood" or not ignores_likelihood(config)]
    return {group: traits_of(config[group]) for group in chosen}, {g: _name_of(config, g, names) for g in chosen}


def traits_of(node: DictConfig) -> Traits:
    """Return what the class that a node names declares; nested components count with their own traits."""
    return _declared(node) or Traits()


def _declared(node: DictConfig) -> Traits | None:
    declared = getattr(resolved(str(node["_target_"])), "traits", None)
    if declared is None or isinstance(declared, Traits):
        return declared
    traits: Traits = declared({str(key): _value(node, key) for key in node if key != "_target_"})
    return traits


def _value(node: DictConfig, key: Any) -> Any:
    """Return a key's value, of a nested component its traits; None where it is missing or cannot be resolved."""
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
    """Return by pair of groups, for every option of the first, the options of the second it cannot use and why.

    traits: by group, of its options by name.
    """
    return {
        f"{first} with {second}": {name: _with(part, second, traits[second]) for name, part in traits[first].items()}
        for first, second in PAIRS
    }


def _with(part: Traits, group: str, others: Mapping[str, Traits]) -> str:
    if part.missing:
        return f"works with another part inside: {part.missing}"
    reasons = []
    for word in sorted(part.requires.get(group, ())):
        lacking = [name for name, other in others.items() if word not in other.provides]
        reasons += [f"needs {word}: not with {', '.join(lacking)}"] if lacking else []
    return "; ".join(reasons) or ("all" if group in part.requires else f"all; needs nothing of the {group}")
