"""Repeat a recorded run with changes: `workbench run from=RUN.rrd seed=3`."""

import logging
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import composed, prepare_hydra
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.experiment.provenance import Command
from workbench.experiment.run import execute
from workbench.experiment.summary import Summary
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.recording.settings import NO_EFFECT, choices_of, leaves
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

_FOLDER = "hydra.run.dir="


def repeat(arguments: Sequence[str]) -> Summary:
    """Run the configuration of `from=RUN.rrd` with the other arguments, and log the differences.

    A key overrides the recorded one. An option of a group, such as prior=smooth, replaces the component with today's
    settings of the recorded experiment. The run is written to the usual folder or hydra.run.dir=FOLDER.

    Raises
    ------
    InputError : a change that is not possible.
    """
    sources = [text.removeprefix("from=") for text in arguments if text.startswith("from=")]
    if len(sources) != 1 or any(text.startswith("-") for text in arguments):
        raise InputError("from=RUN.rrd starts one run: expected it once, with key=value and group=option, without -m")
    folders = [text.removeprefix(_FOLDER) for text in arguments if text.startswith(_FOLDER)]
    overrides = [text for text in arguments if not text.startswith(("from=", _FOLDER, "component_packages="))]
    prepare_hydra()
    run = read_sound_run(Path(sources[0]))
    config, command = repeated_config(run, overrides)
    recorded, _ = repeated_config(run, _path_overrides(overrides))
    first, second = (OmegaConf.to_container(settings, resolve=True) for settings in (recorded, config))
    for difference in changes(first, second):
        log.info(difference)
    experiment = command.choices["experiment"]
    default = Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
    folder = Path(folders[-1]) if folders else default
    if folder.resolve() == run.path.resolve().parent:
        raise InputError(f"{folder}: contains the run to repeat; choose another folder by {_FOLDER}FOLDER")
    return execute(config, experiment, folder, command=command)


def repeated_config(run: Run, overrides: Sequence[str]) -> tuple[DictConfig, Command]:
    """Return the recorded configuration with overrides, and its command; see `repeat`."""
    chosen = {group: name for group, _, name in (text.partition("=") for text in overrides) if group in GROUPS}
    keys = [text for text in overrides if text.partition("=")[0] not in chosen]
    choices, components = {**_choices(run), **chosen}, dict[str, Any]()
    if chosen:
        today = composed([*(f"{group}={name}" for group, name in choices.items()), *_path_overrides(keys)])
        plain: Any = OmegaConf.to_container(today, resolve=True)
        components = {group: plain[group] for group in chosen}
    config = runnable_config(run, keys, current_defaults(keys), components)
    return config, Command([f"from={run.path}", *overrides], choices, run.id)


def changes(before: Any, after: Any) -> list[str]:
    """Return "key: before → after" for every key that differs, except keys without effect on the numbers."""
    first, second = dict(leaves(before)), dict(leaves(after))
    names = [name for name in dict.fromkeys([*first, *second]) if name.partition(".")[0] not in NO_EFFECT]
    values = ((name, first.get(name, "missing"), second.get(name, "missing")) for name in names)
    return [f"{name}: {old} → {new}" for name, old, new in values if old != new]


def _path_overrides(overrides: Iterable[str]) -> list[str]:
    """Return the overrides of paths."""
    return [text for text in overrides if text.startswith("paths.")]


def _choices(run: Run) -> dict[str, str]:
    """Return the recorded experiment and options, as far as they exist today."""
    provenance = run.provenance
    recorded, experiment = choices_of(provenance.get("choices") or ()), str(provenance.get("experiment", "custom"))
    existing = {group: name for group, name in recorded.items() if group in GROUPS and name in options(group)}
    return {"experiment": experiment if experiment in options("experiment") else "custom", **existing}
