"""`workbench diagnose`: find the cause of a lost track by repeating the run with one change at a time."""

import os
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from typer import Argument, Option

from workbench.experiment.config.options import allow_packages, packages_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.recording.read.crash_probe import read_sound_run
from workbench.results.diagnose import AFTER, conclusion, lost_frames, table
from workbench.results.diagnose import diagnose as repeat_with_changes
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible


@interruptible()
def diagnose(
    recording: Annotated[Path, Argument(metavar="RUN.rrd", help="A run that lost the track.")],
    overrides: Annotated[
        list[str] | None, Argument(metavar="[KEY=VALUE]...", help="Overrides of every repetition, such as paths.data=…")
    ] = None,
    frame: Annotated[int | None, Option(help="Frame of the loss; default: every recorded loss.")] = None,
    seeds: Annotated[int, Option(min=1, help="Repetitions of each change.")] = 5,
    jobs: Annotated[int, Option(min=1, help="Number of processes; default: number of cores.")] = os.cpu_count() or 1,
    output: Annotated[Path | None, Option("-o", "--output", help="Write the repetitions to this folder.")] = None,
) -> None:
    """Rank the changes that prevent a track loss: another seed, more particles, other cues or priors, no perturbation.

    Examples:
      workbench diagnose run.rrd
      workbench diagnose video/run.rrd --frame 120 -o repetitions
    """
    words = overrides or []
    allow_packages(packages_in(words))
    words = [word for word in words if not word.startswith("component_packages=")]
    prepare_hydra()
    run = read_sound_run(recording)
    lost = lost_frames(run)
    if frame is not None and frame not in run.poses[0]:
        raise InputError(f"{run.path}: --frame: expected a recorded frame, found {frame}")
    if frame is None and not lost:
        print(f"{run.path}: no track loss is recorded; --frame N repeats the run up to frame N")
    for loss in lost if frame is None else [frame]:
        stretch = f"{int(run.poses[0][0])} to {loss + AFTER}"
        print(f"{run.path}: track lost in frame {loss}; repeating frames {stretch}", flush=True)
        with TemporaryDirectory(prefix="workbench-") if output is None else nullcontext(output) as folder:
            outcomes, refused = repeat_with_changes(run, loss, words, seeds, jobs, Path(folder, f"frame_{loss}"))
        print("\n".join([*(f"omitted: {reason}" for reason in refused), table(outcomes), conclusion(outcomes)]))
    if output is not None:
        print(f"repetitions: workbench view {output}")
