"""What goes with what, told by the parts' classes before any of them is built."""

from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.core.capabilities import EVIDENCE, Traits
from workbench.experiment.config.instantiate import resolved

GROUPS = ("dataset", "prior", "likelihood", "inference")


def incompatibility(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Say the first thing that a part needs and does not get, in one sentence; None where all goes together.

    names: the options chosen, by group; the classes' names stand for those that are not given.
    """
    looked_at = [group for group in GROUPS if config.get(group) is not None and group not in unread(config)]
    traits = {group: traits_of(config[group]) for group in looked_at}
    called = {group: name_of(config, group, names) for group in traits}
    for group, part in reversed(traits.items()):
        if part.lacks:
            return f"config: {called[group]}: {part.lacks}"
        for other, words in part.needs.items():
            if other not in GROUPS:
                continue
            if other not in traits and group == "dataset":
                continue  # which asks what the others are like, not that they are there
            if other not in traits:
                return f"config: {called[group]} needs a {other}, and there is none"
            for word in sorted(words - traits[other].offers):
                return f"config: {called[group]} needs {word} of the {other}, which {called[other]} does not have"
    shown = traits["dataset"].offers if "dataset" in traits else frozenset()
    for group, part in traits.items():
        for word in sorted(part.needs.get("without", frozenset()) & shown):
            return f"config: {called[group]} is not for {word}, which {called['dataset']} shows"
    return _used_twice(traits, called)


def _used_twice(traits: Mapping[str, Traits], called: Mapping[str, str]) -> str | None:
    """Say what the likelihood would weigh although another part has taken it for something else."""
    weighed = traits["likelihood"].needs.get("dataset", frozenset()) if "likelihood" in traits else frozenset()
    for group, part in traits.items():
        for word in sorted(part.needs.get("apart", frozenset()) & weighed):
            return f"config: {called[group]} starts from {word}, which {called['likelihood']} would use a second time"
    return None


def unread(config: DictConfig) -> tuple[str, ...]:
    """Name the groups chosen that the inference does not look at: the likelihood, for one that says it needs none."""
    declared = _declared(config.inference)
    ignored = declared is not None and "likelihood" not in declared.needs
    return ("likelihood",) if ignored and config.get("likelihood") is not None else ()


def no_evidence(config: DictConfig, names: Mapping[str, str] | None = None) -> str | None:
    """Say why the likelihood's evidence cannot be compared between runs; None where it can.

    A likelihood that is averaged, flattened, weighted or made from the run's own estimates is no density of the data.
    """
    if config.get("likelihood") is None or unread(config):
        return "there is no likelihood"
    if EVIDENCE in traits_of(config.likelihood).offers:
        return None
    return f"{name_of(config, 'likelihood', names or {})} is not {EVIDENCE}"


def traits_of(node: DictConfig) -> Traits:
    """Collect what the class that a node names declares, its nested parts first."""
    return _declared(node) or Traits()


def _declared(node: DictConfig) -> Traits | None:
    """As `traits_of`; None where the class declares nothing."""
    target = str(node["_target_"])
    declared = getattr(resolved(target), "traits", None)
    if declared is None or isinstance(declared, Traits):
        return declared
    traits: Traits = declared({str(key): _value(node, str(key)) for key in node if key != "_target_"})
    return traits


def _value(node: DictConfig, key: str) -> Any:
    """Take a key's value: of a nested part its traits, of a mapping of parts theirs by name."""
    if OmegaConf.is_missing(node, key):
        return None
    try:
        value = node[key]
    except OmegaConfBaseException:  # whoever builds the part will say so
        return None
    if not isinstance(value, DictConfig):
        return value
    if "_target_" in value:
        return traits_of(value)
    return {str(name): _value(value, str(name)) for name in value}


def name_of(config: DictConfig, group: str, names: Mapping[str, str]) -> str:
    """Say which part is chosen of a group: group=option, as far as `names` knows it, or else group=class."""
    return f"{group}={names.get(group) or str(config[group]['_target_']).rpartition('.')[2]}"


PAIRS = (
    ("inference", "prior"), ("inference", "likelihood"), ("inference", "dataset"),
    ("likelihood", "dataset"), ("prior", "dataset"),
)  # fmt: skip
"""Groups of which the first needs something of the second."""


def table(traits: Mapping[str, Mapping[str, Traits]]) -> dict[str, dict[str, str]]:
    """Say what goes with what: by pair of groups, for every option of the first, which of the second do not and why.

    traits: by group, of its options by name, as they stand.
    """
    return {
        f"{first} with {second}": {name: _with(part, second, traits[second]) for name, part in traits[first].items()}
        for first, second in PAIRS
    }


def _with(part: Traits, group: str, others: Mapping[str, Traits]) -> str:
    """Name the options that lack what a part needs of their group, by what they lack."""
    if part.lacks:
        return f"works with another part inside: {part.lacks}"
    reasons = []
    for word in sorted(part.needs.get(group, ())):
        lacking = [name for name, other in others.items() if word not in other.offers]
        reasons += [f"needs {word}: not with {', '.join(lacking)}"] if lacking else []
    return "; ".join(reasons) or ("all" if group in part.needs else f"all; needs nothing of the {group}")
