"""A new run from what a recording was made with: `workbench from=RUN.rrd seed=3 prior=smooth`."""

import logging
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_module
from omegaconf import DictConfig, OmegaConf

from workbench.errors import InputError
from workbench.experiment.execute import execute
from workbench.experiment.parts import GROUPS, options
from workbench.experiment.provenance import Command
from workbench.experiment.schema import prepare_hydra
from workbench.experiment.stored import own_defaults, runnable
from workbench.experiment.summary import Summary
from workbench.recording.read.reader import Run, read
from workbench.report.variation import leaves

log = logging.getLogger(__name__)

_FOLDER = "hydra.run.dir="
_ALWAYS_OURS = ("paths.", "threads", "recorder.live", "check.", "given")


def branch(arguments: Sequence[str]) -> Summary:
    """Run the configuration that `from=RUN.rrd` names with the other arguments, and say what differs.

    A key replaces the recorded one; a group's option, such as prior=smooth, puts in that part as the recorded
    experiment has it today. The run goes where others go, or to hydra.run.dir=FOLDER. Raises InputError for what cannot
    be changed.
    """
    sources = [text.removeprefix("from=") for text in arguments if text.startswith("from=")]
    if len(sources) != 1 or any(text.startswith("-") for text in arguments):
        raise InputError("from=RUN.rrd starts one run: say it once, with key=value and group=option, without -m")
    folders = [text.removeprefix(_FOLDER) for text in arguments if text.startswith(_FOLDER)]
    overrides = [text for text in arguments if not text.startswith(("from=", _FOLDER, "parts="))]
    prepare_hydra()
    run = read(sources[0])
    config, command = branched(run, overrides)
    experiment = command.choices.get("experiment", "custom")
    for sentence in changes(run.settings, OmegaConf.to_container(config, resolve=True)):
        log.info(sentence)
    usual = Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
    return execute(config, experiment, Path(folders[-1]) if folders else usual, command=command)


def branched(run: Run, overrides: Sequence[str]) -> tuple[DictConfig, Command]:
    """The recorded configuration with overrides, and what stands for it as a command; see `branch`."""
    chosen = {group: name for group, _, name in (text.partition("=") for text in overrides) if group in GROUPS}
    keys = [text for text in overrides if text.partition("=")[0] not in chosen]
    own = own_defaults(keys)
    recorded = _choices(run)
    parts = {group: _today(recorded, chosen, keys)[group] for group in chosen}
    config = runnable(run, keys, own, parts)
    identity = str(run.properties["run"].get("id", ""))
    return config, Command([f"from={run.path}", *overrides], {**recorded, **chosen}, parent=identity)


def changes(was: Mapping[str, Any], now: Any) -> list[str]:
    """A sentence for every key that differs, but for where things are."""
    first, second = dict(leaves(was)), dict(leaves(now))
    names = [name for name in dict.fromkeys([*first, *second]) if not name.startswith(_ALWAYS_OURS)]
    return [
        f"{name}: {first.get(name, 'not there')} → {second.get(name, 'not there')}"
        for name in names
        if first.get(name, "not there") != second.get(name, "not there")
    ]


def _choices(run: Run) -> dict[str, str]:
    """The recorded experiment and options, as far as there are such today."""
    words = run.provenance.get("choices") or []
    pairs = (str(word).partition("=") for word in ([words] if isinstance(words, str) else words))
    recorded = {group: name for group, _, name in pairs if group in GROUPS and name in options(group)}
    experiment = str(run.provenance.get("experiment", "custom"))
    return {"experiment": experiment if experiment in options("experiment") else "custom", **recorded}


def _today(recorded: Mapping[str, str], chosen: Mapping[str, str], keys: Sequence[str]) -> dict[str, Any]:
    """Compose the recorded experiment with the options chosen now."""
    places = [text for text in keys if text.startswith("paths.")]
    said = [f"{group}={name}" for group, name in {**recorded, **chosen}.items()]
    with initialize_config_module("workbench.conf", version_base="1.3"):
        found: Any = OmegaConf.to_container(compose("config", overrides=[*said, *places]), resolve=True)
    return dict(found)
