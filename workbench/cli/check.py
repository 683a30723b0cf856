"""`workbench check`: regression check of recordings against new runs of their configurations."""

import os
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from typer import Argument, Exit, Option

from workbench.cli.hydra_quoting import quoted
from workbench.cli.run_output import print_warnings
from workbench.experiment.config.options import allow_packages, packages_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import current_defaults
from workbench.experiment.repeat import changes
from workbench.recording.read.reader import Run
from workbench.recording.side_by_side import write_side_by_side
from workbench.results.check.against import check_against
from workbench.results.check.outcome import Check, exit_code, moved, notes, table, write_junit
from workbench.results.check.rerun import Request, check_each, check_groups, check_two, read_sound, renew
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible
from workbench.utils.text import printable


@interruptible()
def check(
    what: Annotated[
        list[str],
        Argument(metavar="FOLDER|RUN.rrd|KEY=VALUE...", help="Recordings, and overrides such as paths.data=DATA."),
    ],
    run: Annotated[bool, Option("--run", help="Repeat the runs, also for exactly two recordings.")] = False,
    seeds: Annotated[int | None, Option(min=2, help="Compare the distributions over N other seeds.")] = None,
    paired: Annotated[bool, Option("--paired", help="Test the differences between runs of equal seeds.")] = False,
    against: Annotated[str | None, Option(metavar="REV", help="Compare this code with another commit's.")] = None,
    exact: Annotated[bool, Option("--exact", help="Require bitwise identical numbers.")] = False,
    update: Annotated[bool, Option("--update", help="Replace the recordings by the new runs.")] = False,
    reason: Annotated[str | None, Option(help="With --update: the reason, appended to reasons.md.")] = None,
    record: Annotated[Path | None, Option(metavar="DIFF.rrd", help="Write both runs into one recording.")] = None,
    junit: Annotated[Path | None, Option(metavar="OUT.xml", help="Write the results as JUnit XML.")] = None,
    output: Annotated[Path | None, Option("-o", "--output", help="Write the new runs to this folder.")] = None,
    verbose: Annotated[bool, Option("-v", "--verbose", help="Also print the metrics that passed.")] = False,
) -> None:
    """Repeat recorded runs and compare every metric: identical, equal up to rounding, within tolerance, or changed.

    Exactly two recordings are compared with each other without a new run. In the
    environment of the recording metrics must be equal up to rounding, in another
    environment within the measured tolerances or those of the configuration (check:).

    Examples:
      workbench check recordings/baselines --against HEAD~1
      workbench check a.rrd b.rrd --record diff.rrd
    """
    print_warnings()
    modes = {"--seeds": seeds is not None, "--paired": paired, "--against": against is not None}
    chosen = [name for name, is_set in modes.items() if is_set]
    if len(chosen) > 1:
        raise InputError(f"{chosen[0]} and {chosen[1]}: expected at most one of them")
    if chosen and (update or record is not None):
        raise InputError(f"{chosen[0]} cannot be combined with --update or --record")
    if reason is not None and not update:
        raise InputError("--reason: expected it together with --update")
    if exact and (seeds is not None or paired):
        raise InputError("--exact cannot be combined with --seeds or --paired")
    overrides = [text for text in what if "=" in text and not Path(text).exists()]
    places = [Path(text) for text in what if text not in overrides]
    two = len(places) == 2 and all(place.is_file() for place in places) and not (run or chosen)
    if two and (overrides or update):
        raise InputError("two recordings are compared without running; --run runs each of them again")
    if paired and any(text.startswith("seed=") for text in overrides):
        raise InputError("--paired uses the recorded seeds; remove seed=")
    allow_packages(packages_in(overrides))
    overrides = [quoted(text) for text in overrides if not text.startswith("component_packages=")]
    runs, checks = read_sound(places)
    if not runs and not checks:
        raise InputError(f"{', '.join(map(str, places)) or 'no folder'}: expected recordings (.rrd), found none")
    prepare_hydra()
    with TemporaryDirectory(prefix="workbench-") if output is None else nullcontext(output) as folder:
        request = Request(overrides, current_defaults(overrides), Path(folder), exact)
        if two:
            by_path = {run.path: run for run in runs}
            checks = checks or [_compared(by_path[places[0]], by_path[places[1]], request)]
        elif seeds is not None or paired:
            checks += check_groups(runs, request, seeds)
        elif against is not None:
            checks += check_against(runs, request, against)
        else:
            checks += check_each(runs, request)
        print(moved(checks) if update else table(checks, verbose), flush=True)
        for line in notes(checks):
            print(line, flush=True)
        code = renew(checks, reason) if update else exit_code(checks)
        if junit is not None:
            write_junit(junit, checks)
        if record is not None:
            _record(record, checks)
    raise Exit(code)


def _compared(was: Run, now: Run, request: Request) -> Check:
    """Compare two recordings, and print the differing keys of their configurations."""
    if differences := changes(was.settings, now.settings):
        print("\n".join(["different configurations:", *(f"  {printable(text)}" for text in differences)]))
    return check_two(f"{was.path} → {now.path}", was, now, request)


def _record(path: Path, checks: Sequence[Check]) -> None:
    """Write both runs of the first failed recording, else of the first, into one recording."""
    pairs = sorted((check for check in checks if check.was and check.now), key=lambda check: check.passed)
    if not pairs or pairs[0].was is None or pairs[0].now is None:
        raise InputError(f"{path}: expected two runs to show side by side, found none")
    with whole_file(path) as part:
        write_side_by_side(part, pairs[0].was, pairs[0].now)
    print(f"{pairs[0].name}: both runs: workbench view {os.path.relpath(path)}")
