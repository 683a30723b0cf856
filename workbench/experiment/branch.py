"""Repeat a recorded run with changes, or resume it from a frame: `workbench run from=RUN.rrd`."""

import logging
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from omegaconf import OmegaConf

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.resume import Continuation, branch_config, changes, path_overrides
from workbench.experiment.run import execute
from workbench.experiment.summary import Summary
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING

log = logging.getLogger(__name__)

_FOLDER = "hydra.run.dir="


def branch(arguments: Sequence[str]) -> Summary:
    """Run the configuration of `from=RUN.rrd` with the other arguments, and log the differences.

    `from=RUN.rrd@120` resumes at that frame, and `from=FOLDER` an interrupted run at its last recorded frame; see
    `Continuation`. A key overrides the recorded one. An option of a group, such as prior=smooth, replaces the component
    with today's settings of the recorded experiment. The run is written to the usual folder or hydra.run.dir=FOLDER.

    Raises
    ------
    InputError : a change or frame that is not possible.
    """
    sources = [text.removeprefix("from=") for text in arguments if text.startswith("from=")]
    if len(sources) != 1 or any(text.startswith("-") for text in arguments):
        raise InputError("from=RUN.rrd starts one run: expected it once, with key=value and group=option, without -m")
    folders = [text.removeprefix(_FOLDER) for text in arguments if text.startswith(_FOLDER)]
    overrides = [text for text in arguments if not text.startswith(("from=", _FOLDER, "component_packages="))]
    prepare_hydra()
    run, frame = _source(sources[0])
    config, command = branch_config(run, overrides, frame)
    recorded, _ = branch_config(run, path_overrides(overrides))
    first, second = (OmegaConf.to_container(settings, resolve=True) for settings in (recorded, config))
    differences = changes(first, second)
    for difference in differences:
        log.info(difference)
    continued = None if frame is None else Continuation(run, frame, recorded, changed=bool(differences))
    experiment = command.choices["experiment"]
    default = Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
    folder = Path(folders[-1]) if folders else default
    if folder.resolve() == run.path.resolve().parent:
        raise InputError(f"{folder}: contains the run to resume; choose another folder by {_FOLDER}FOLDER")
    summary = execute(config, experiment, folder, command=command, continued=continued)
    if continued is not None:
        log.info("compare both runs: workbench view %s %s", run.path, summary.recording)
    return summary


def _source(text: str) -> tuple[Run, int | None]:
    """Return the run after `from=` and the frame at which it resumes, None to start from scratch.

    Raises
    ------
    InputError : a folder without a recording, or the folder of a complete run without a frame.
    """
    at = None if Path(text).exists() else re.fullmatch(r"(.+)@(\d+)", text)
    place, frame = (Path(at[1]), int(at[2])) if at else (Path(text), None)
    if not place.is_dir():
        return read_sound_run(place), frame
    recordings = [path for name in (PART, RECORDING) if (path := place / name).is_file()]
    if not recordings:
        raise InputError(f"{place}: expected {RECORDING} or {PART}, found neither")
    run = read_sound_run(recordings[0])
    if frame is None and run.status == "complete":
        raise InputError(
            f"{place}: the run is complete; from={run.path} repeats it, from={run.path}@FRAME resumes it at a frame"
        )
    if frame is None and not len(run.poses[0]):
        raise InputError(
            f"{run.path}: expected a frame at which to resume, found none; from={run.path} starts from scratch"
        )
    return run, int(run.poses[0][-1]) if frame is None else frame
