"""`workbench diagnose`: why a run lost the track, by repeating it with one thing changed at a time."""

import os
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from typer import Argument, Option

from workbench.experiment.config.options import name_parts, parts_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.recording.read.crash_probe import read_sound_run
from workbench.results.diagnose import AFTER, BEFORE, conclusion, lost_frames, table
from workbench.results.diagnose import diagnose as repeat_with_changes
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible


@interruptible()
def diagnose(
    recording: Annotated[Path, Argument(metavar="RUN.rrd", help="A run that lost the track.")],
    overrides: Annotated[
        list[str] | None, Argument(metavar="[KEY=VALUE]...", help="Changed in every repetition, such as paths.data=…")
    ] = None,
    frame: Annotated[int | None, Option(help="Frame of the loss; by default every loss that the run knows.")] = None,
    seeds: Annotated[int, Option(min=1, help="Repetitions with each change.")] = 5,
    jobs: Annotated[int, Option(min=1, help="Processes; by default one for each core.")] = os.cpu_count() or 1,
    output: Annotated[Path | None, Option("-o", "--output", help="Keep the repetitions in this folder.")] = None,
) -> None:
    """Rank what would have kept a lost track: another seed, more particles, other cues or priors, a truer scene.

    Examples:

    workbench diagnose run.rrd

    workbench diagnose video/run.rrd --frame 120 -o repetitions
    """
    words = overrides or []
    name_parts(parts_in(words))
    words = [each for each in words if not each.startswith("parts=")]
    prepare_hydra()
    run = read_sound_run(recording)
    lost = lost_frames(run)
    if frame is not None and frame not in run.poses[0]:
        raise InputError(f"{run.path}: expected a recorded frame after --frame, found {frame}")
    if frame is None and not lost:
        print(f"{run.path}: the track is never lost; --frame N repeats from before frame N")
    for each in lost if frame is None else [frame]:
        stretch = f"{max(each - BEFORE, int(run.poses[0][0]))} to {each + AFTER}"
        print(f"{run.path}: lost in frame {each}; repeated in frames {stretch}", flush=True)
        with TemporaryDirectory(prefix="workbench-") if output is None else nullcontext(output) as folder:
            outcomes, refused = repeat_with_changes(run, each, words, seeds, jobs, Path(folder, f"frame_{each}"))
        print("\n".join([*(f"left out: {words}" for words in refused), table(outcomes), conclusion(outcomes)]))
    if output is not None:
        print(f"repetitions: workbench view {output}")
