"""The resolved configuration of every experiment equals that in resolved_experiments.yaml.

The file lists the keys of every component with the defaults of its class. For each experiment it lists the chosen
components and the values that differ from these defaults, with recorded motions, and what differs without them. After
an intended change, `python tests/contract/test_resolved_experiments.py` writes the file again; its diff shows which
keys of which experiments changed.
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

FILE = Path(__file__).with_name("resolved_experiments.yaml")
EXPERIMENTS = sorted(options("experiment"))
DATA_FOLDERS = {"recorded": "DATA", "generated": None}
"""Values of paths.data; a placeholder, so that the file names no folder of a machine."""


def composed(experiment):
    """Yield an experiment's resolved configuration for every data folder; it is composed once."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[f"experiment={experiment}", "paths.data=DATA", "paths.cache=CACHE"])
        for data in DATA_FOLDERS.values():
            config.paths.data = data
            yield OmegaConf.to_container(config, resolve=True)


def changes(value, path="", defaults=None):
    """Yield lines "key: value" of values that differ from the defaults of the components' classes."""
    if isinstance(value, dict) and "_target_" in value:
        yield f"{path}: {value['_target_']}"
        defaults = class_defaults(value["_target_"])
    if isinstance(value, dict) and value:
        for key, item in value.items():
            if key != "_target_" and (defaults is None or key not in defaults or item != defaults[key]):
                yield from changes(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for i, item in enumerate(value):
            yield from changes(item, f"{path}.{i}")
    else:
        yield f"{path}: {json.dumps(value, ensure_ascii=False)}"


def class_defaults(target):
    """Return the defaults of a component's keys, without defaults that are components."""
    keys = {name: default for name, (_, default) in config_keys(import_target(target)).items()}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in keys.items() if plain(value)}


def plain(value):
    return value is not inspect.Parameter.empty and isinstance(value, str | bool | int | float | list | tuple | None)


def lines_of(experiment, shared=()):
    """Return an experiment's lines without the shared ones: with recorded motions, then those that differ without."""
    recorded, generated = ([*changes(config)] for config in composed(experiment))
    lines = [*recorded, *(f"generated {line}" for line in generated if line not in recorded)]
    return [line for line in lines if line not in shared]


def shared_lines():
    """Return the lines outside of components, which all experiments share."""
    return [line for line in lines_of("custom") if not line.removeprefix("generated ").startswith(GROUPS)]


def class_sections(lines):
    """Return the defaults of every class that is an option or that the lines name."""
    named = {value for value in (line.partition(": ")[2] for line in lines) if value.startswith("workbench.")}
    classes = named | {option.target for group in GROUPS for option in options(group).values() if option.target}
    return {
        target: [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in class_defaults(target).items()]
        for target in sorted(classes)
    }


def recorded_sections():
    """Return the file's sections by name: shared lines, classes and experiments."""
    rows = [section.splitlines() for section in FILE.read_text(encoding="utf-8").strip().split("\n\n")[1:]]
    return {name.removesuffix(":"): [line.removeprefix("  ") for line in lines] for name, *lines in rows}


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@pytest.mark.slow
def test_every_experiment_composes_to_its_recorded_configuration(experiment):
    sections = recorded_sections()
    assert options("experiment")[experiment].about
    assert lines_of(experiment, sections["everywhere"]) == sections.get(experiment)


def test_classes_have_their_recorded_defaults_and_no_section_is_obsolete():
    sections = recorded_sections()
    shared, experiments = sections.pop("everywhere"), {name: sections.pop(name, []) for name in EXPERIMENTS}
    assert shared == shared_lines()
    assert sections == class_sections(line for lines in experiments.values() for line in lines)


def renew():
    """Write the file."""
    shared = shared_lines()
    experiments = {experiment: lines_of(experiment, shared) for experiment in EXPERIMENTS}
    classes = class_sections(line for lines in experiments.values() for line in lines)
    text = ["# Written by `python tests/contract/test_resolved_experiments.py`, which describes it."]
    for name, lines in ({"everywhere": shared} | classes | experiments).items():
        text.append("\n".join([f"{name}:", *(f"  {line}" for line in lines)]))
    FILE.write_text("\n\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    renew()
