"""What every experiment is, to the last number: its configuration, resolved, as resolved_experiments.yaml has it.

That file lists the keys of every part with the defaults of its class, and then, for each experiment, which parts it
chooses and where it departs from their defaults; with recorded motions, and what is different without any. Where a
change is meant, `python tests/contract/test_resolved_experiments.py` writes the file anew, and its diff tells which
keys of which experiments moved.
"""

import inspect
import json
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import prepare_hydra

KEPT = Path(__file__).with_name("resolved_experiments.yaml")
EXPERIMENTS = sorted(options("experiment"))
PLACES = {"recorded": "DATA", "generated": None}
"""What paths.data says, so that no place of a machine is in the file."""


def composed(experiment):
    """An experiment's configuration in every place; what it chooses is the same in all, so it is composed once."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[f"experiment={experiment}", "paths.data=DATA", "paths.cache=CACHE"])
        for data in PLACES.values():
            config.paths.data = data
            yield OmegaConf.to_container(config, resolve=True)


def departures(value, path="", defaults=None):
    """Give lines "key: value" of what a configuration says beside the defaults of its parts' classes."""
    if isinstance(value, dict) and "_target_" in value:
        yield f"{path}: {value['_target_']}"
        defaults = class_defaults(value["_target_"])
    if isinstance(value, dict) and value:
        for key, item in value.items():
            if key != "_target_" and (defaults is None or key not in defaults or item != defaults[key]):
                yield from departures(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for i, item in enumerate(value):
            yield from departures(item, f"{path}.{i}")
    else:
        yield f"{path}: {json.dumps(value, ensure_ascii=False)}"


def class_defaults(target):
    """A part's keys, with what its class has where nothing is said; parts of its own make themselves."""
    found = {name: default for name, (_, default) in config_keys(import_target(target)).items()}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in found.items() if plain(value)}


def plain(value):
    return value is not inspect.Parameter.empty and isinstance(value, str | bool | int | float | list | tuple | None)


def lines_of(experiment, shared=()):
    """An experiment's lines but those shared by all: with recorded motions, and then those that differ without."""
    recorded, generated = ([*departures(each)] for each in composed(experiment))
    every = [*recorded, *(f"generated {line}" for line in generated if line not in recorded)]
    return [line for line in every if line not in shared]


def shared_lines():
    """The lines of all experiments: what is said outside of parts."""
    return [line for line in lines_of("custom") if not line.removeprefix("generated ").startswith(GROUPS)]


def part_sections(lines):
    """The defaults of every class that may be chosen or that lines name."""
    named = {value for value in (line.partition(": ")[2] for line in lines) if value.startswith("workbench.")}
    every = named | {option.target for group in GROUPS for option in options(group).values() if option.target}
    return {
        target: [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in class_defaults(target).items()]
        for target in sorted(every)
    }


def kept():
    """The file's sections, by name: of what all experiments share, of classes, and of experiments."""
    rows = [section.splitlines() for section in KEPT.read_text(encoding="utf-8").strip().split("\n\n")[1:]]
    return {name.removesuffix(":"): [line.removeprefix("  ") for line in lines] for name, *lines in rows}


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@pytest.mark.slow
def test_every_experiment_composes_to_what_was_kept(experiment):
    sections = kept()
    assert options("experiment")[experiment].about
    assert lines_of(experiment, sections["everywhere"]) == sections.get(experiment)


def test_classes_have_the_defaults_that_were_kept_and_nothing_is_kept_of_experiments_that_are_gone():
    sections = kept()
    shared, experiments = sections.pop("everywhere"), {name: sections.pop(name, []) for name in EXPERIMENTS}
    assert shared == shared_lines()
    assert sections == part_sections(line for lines in experiments.values() for line in lines)


def renew():
    """Write the file."""
    shared = shared_lines()
    experiments = {experiment: lines_of(experiment, shared) for experiment in EXPERIMENTS}
    classes = part_sections(line for lines in experiments.values() for line in lines)
    text = ["# Written by `python tests/contract/test_resolved_experiments.py`, which says what this is."]
    for name, lines in ({"everywhere": shared} | classes | experiments).items():
        text.append("\n".join([f"{name}:", *(f"  {line}" for line in lines)]))
    KEPT.write_text("\n\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    renew()
