"""A new run of a recorded configuration, `workbench run from=RUN.rrd seed=3 prior=smooth`, from its first frame or,
`from=RUN.rrd@120`, from another one."""

import logging
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.composition import composed
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import own_defaults, runnable
from workbench.experiment.continuing import Continued
from workbench.experiment.execute import execute
from workbench.experiment.provenance import Command
from workbench.experiment.summary import Summary
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.recording.settings import NO_EFFECT, leaves
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING

log = logging.getLogger(__name__)

_FOLDER = "hydra.run.dir="


def branch(arguments: Sequence[str]) -> Summary:
    """Run the configuration that `from=RUN.rrd` names with the other arguments, and say what differs.

    `from=RUN.rrd@120` goes on from that frame, and `from=FOLDER`, of a run that was cut off, from the last that is on
    the disk; see `Continued`. A key replaces the recorded one; a group's option, such as prior=smooth, puts in that
    part as the recorded experiment has it today. The run goes where others go, or to hydra.run.dir=FOLDER. Raises
    InputError for what cannot be changed or continued.
    """
    sources = [text.removeprefix("from=") for text in arguments if text.startswith("from=")]
    if len(sources) != 1 or any(text.startswith("-") for text in arguments):
        raise InputError("from=RUN.rrd starts one run: say it once, with key=value and group=option, without -m")
    folders = [text.removeprefix(_FOLDER) for text in arguments if text.startswith(_FOLDER)]
    overrides = [text for text in arguments if not text.startswith(("from=", _FOLDER, "parts="))]
    prepare_hydra()
    run, frame = source(sources[0])
    continued = None if frame is None else continued_at(run, frame, overrides)
    config, command = branched(run, overrides, frame)
    experiment = command.choices.get("experiment", "custom")
    for sentence in changes(run.settings, OmegaConf.to_container(config, resolve=True)):
        log.info(sentence)
    usual = Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
    folder = Path(folders[-1]) if folders else usual
    if folder.resolve() == run.path.resolve().parent:
        raise InputError(f"{folder}: holds the run that is gone on from; choose another by {_FOLDER}FOLDER")
    summary = execute(config, experiment, folder, command=command, continued=continued)
    if continued is not None:
        log.info("both under one cursor: workbench view %s %s", run.path, summary.recording)
    return summary


def source(text: str) -> tuple[Run, int | None]:
    """Read what stands after `from=`: the run, and the frame to go on from; None to begin anew.

    Raises InputError for a folder without a recording, or of a complete run without a frame.
    """
    at = None if Path(text).exists() else re.fullmatch(r"(.+)@(\d+)", text)
    place, frame = (Path(at[1]), int(at[2])) if at else (Path(text), None)
    if not place.is_dir():
        return read_sound_run(place), frame
    found = [path for name in (PART, RECORDING) if (path := place / name).is_file()]
    if not found:
        raise InputError(f"{place}: expected {RECORDING} or {PART} in it, found neither")
    run = read_sound_run(found[0])
    if frame is None and run.status == "complete":
        raise InputError(f"{place}: the run is complete; from={run.path} starts it anew, from={run.path}@FRAME goes on")
    if frame is None and not len(run.poses[0]):
        raise InputError(f"{run.path}: expected a frame to go on from, found none; from={run.path} starts anew")
    return run, int(run.poses[0][-1]) if frame is None else frame


def continued_at(run: Run, frame: int, overrides: Sequence[str]) -> Continued:
    """Go on from a frame of a run with these overrides; raises InputError for a frame that it does not have."""
    places = [text for text in overrides if text.startswith("paths.")]
    was, now = (branched(run, each)[0] for each in (places, overrides))
    first: Any = OmegaConf.to_container(was, resolve=True)
    changed = bool(changes(first, OmegaConf.to_container(now, resolve=True)))
    return Continued(run, frame, was, changed)


def branched(run: Run, overrides: Sequence[str], frame: int | None = None) -> tuple[DictConfig, Command]:
    """The recorded configuration with overrides, and what stands for it as a command; see `branch`."""
    chosen = {group: name for group, _, name in (text.partition("=") for text in overrides) if group in GROUPS}
    keys = [text for text in overrides if text.partition("=")[0] not in chosen]
    own = own_defaults(keys)
    recorded = _choices(run)
    parts = {group: _today(recorded, chosen, keys)[group] for group in chosen}
    config = runnable(run, keys, own, parts)
    identity, at = run.id, "" if frame is None else f"@{frame}"
    return config, Command([f"from={run.path}{at}", *overrides], {**recorded, **chosen}, identity, frame)


def changes(was: Mapping[str, Any], now: Any) -> list[str]:
    """Describe every key that differs between two configurations, but for those that affect no number."""
    first, second = dict(leaves(was)), dict(leaves(now))
    names = [name for name in dict.fromkeys([*first, *second]) if name.partition(".")[0] not in NO_EFFECT]
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
    found: Any = OmegaConf.to_container(composed([*said, *places]), resolve=True)
    return dict(found)
