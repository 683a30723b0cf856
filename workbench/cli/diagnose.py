"""workbench-why: why a run lost the person, by running it again from before that with one thing changed at a time."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from workbench.experiment.config.options import name_parts, parts_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.resume import branched
from workbench.experiment.tracking import assemble
from workbench.recording.futures import Shown, write_futures
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.results.why.changes import changes_of
from workbench.results.why.futures import Future, Loss, all_futures, losses, past_of
from workbench.results.why.verdict import Verdict, ranked, sentence, table, verdict
from workbench.utils.errors import InputError

FIRST_SEED = 1000
"""Of the futures, which draw otherwise than the run."""


def main(argv: Sequence[str] | None = None) -> int:
    """Tell for every loss what would have held the person. Returns 0, 2 after an error, which is printed, or 130."""
    parser = argparse.ArgumentParser(prog="workbench-why", description=__doc__)
    parser.add_argument("recording", metavar="RUN.rrd", type=Path, help="a run with truth that lost the person")
    parser.add_argument(
        "overrides", metavar="KEY=VALUE", nargs="*", help="changed in all futures, such as paths.data=…"
    )
    parser.add_argument("--seeds", type=int, default=5, help="of every change (default: 5)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: one for every core)")
    parser.add_argument(
        "--output", metavar="FOLDER", type=Path, help="for a recording of all futures of a loss (default: .why beside)"
    )
    arguments = parser.parse_args(argv)
    try:
        if arguments.seeds < 1 or arguments.jobs < 1:
            raise InputError("--seeds, --jobs: expected 1 or more")
        name_parts(parts_in(arguments.overrides))
        prepare_hydra()
        run = read_sound_run(arguments.recording)
        if not (lost := losses(run)):
            print(f"{run.path}: the person is never lost")
            return 0
        folder = arguments.output or run.path.with_name(".why")  # hidden from what goes through folders of runs
        folder.mkdir(parents=True, exist_ok=True)
        for loss in lost:
            output = folder / f"lost_in_{loss.frame}.rrd"
            _explain(run, loss, arguments.overrides, arguments.seeds, arguments.jobs, output)
    except InputError as error:
        print(f"workbench-why: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _explain(run: Run, loss: Loss, overrides: list[str], seeds: int, jobs: int, output: Path) -> None:
    """Run the futures of a loss, tell what came of them and record them."""
    span = f"futures from frame {loss.begin} to {loss.end}, {seeds} seeds each"
    print(f"{run.path}: the person is lost in frame {loss.frame}; {span}", flush=True)
    config = branched(run, overrides)[0]
    past = past_of(run, loss, overrides)
    drawn = list(range(FIRST_SEED, FIRST_SEED + seeds))
    tasks = [(run.path, past, loss, change, drawn, overrides) for change in changes_of(config, from_start=past is None)]
    every: list[list[Future]] = []
    coming = tqdm(all_futures(tasks, jobs), total=len(tasks), unit="change", disable=None)
    for task, found in zip(tasks, coming, strict=True):
        if isinstance(found, InputError):
            print(f"left out: {task[3].name}: {found}")
        else:
            every.append(found)
    verdicts = ranked([verdict(found) for found in every])
    print(table(verdicts))
    print(sentence(verdicts))
    body = assemble(config).body
    write_futures(output, run, body, [_shown(each) for found in every for each in found], _markdown(verdicts))
    print(f"look at them: rerun {output}")


def _shown(future: Future) -> Shown:
    name = f"{future.change.name}, seed {future.seed}"
    own = future.frames, future.times_s, future.errors, future.places, future.cameras
    return Shown(name, *own, future.held)


def _markdown(verdicts: Sequence[Verdict]) -> str:
    return f"```\n{table(verdicts)}\n```\n{sentence(verdicts)}"
