"""The configuration of a recording run again, with changes or from one of its frames: `workbench run from=RUN.rrd`."""

import logging
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from omegaconf import OmegaConf

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.resume import Continued, branched, changes, paths_of
from workbench.experiment.run import execute
from workbench.experiment.summary import Summary
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING

log = logging.getLogger(__name__)

_FOLDER = "hydra.run.dir="


def branch(arguments: Sequence[str]) -> Summary:
    """Run the configuration that `from=RUN.rrd` names with the other arguments, and log what differs.

    `from=RUN.rrd@120` goes on from that frame, and `from=FOLDER`, of a run that was cut off, from the last that is on
    the disk; see `Continued`. A key replaces the recorded one; a group's option, such as prior=smooth, puts in that
    part as the recorded experiment has it today. The run goes where others go, or to hydra.run.dir=FOLDER. Raises
    InputError for what cannot be changed or continued.
    """
    sources = [text.removeprefix("from=") for text in arguments if text.startswith("from=")]
    if len(sources) != 1 or any(text.startswith("-") for text in arguments):
        raise InputError("from=RUN.rrd starts one run: say it once, with key=value and group=option, without -m")
    folders = [text.removeprefix(_FOLDER) for text in arguments if text.startswith(_FOLDER)]
    overrides = [text for text in arguments if not text.startswith(("from=", _FOLDER, "component_packages="))]
    prepare_hydra()
    run, frame = _source(sources[0])
    config, command = branched(run, overrides, frame)
    was, _ = branched(run, paths_of(overrides))
    first, second = (OmegaConf.to_container(each, resolve=True) for each in (was, config))
    differences = changes(first, second)
    for sentence in differences:
        log.info(sentence)
    continued = None if frame is None else Continued(run, frame, was, changed=bool(differences))
    experiment = command.choices["experiment"]
    usual = Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
    folder = Path(folders[-1]) if folders else usual
    if folder.resolve() == run.path.resolve().parent:
        raise InputError(f"{folder}: holds the run that is gone on from; choose another by {_FOLDER}FOLDER")
    summary = execute(config, experiment, folder, command=command, continued=continued)
    if continued is not None:
        log.info("both under one cursor: workbench view %s %s", run.path, summary.recording)
    return summary


def _source(text: str) -> tuple[Run, int | None]:
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
