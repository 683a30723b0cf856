"""workbench-runs: find runs by what they were told and what they came to; look at them, compare them, make room."""

import argparse
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path

from workbench.results.entry import Entry
from workbench.results.index import entries
from workbench.results.listing import as_csv, as_json, best_first, sort, sweeps, table
from workbench.results.query import Condition, chosen, condition
from workbench.results.report.tables import printable, text
from workbench.utils.errors import InputError

HOME = ("recordings/runs", "recordings/sweeps")
FEW = 40
"""Rows in the terminal unless --all is said."""


def main(argv: Sequence[str] | None = None) -> int:
    """Returns 0, 2 after an error, which is printed, or what the viewer or the report returns."""
    arguments = _parser().parse_intermixed_args(argv)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file's name may be no text at all
    try:
        return _act(arguments)
    except InputError as error:
        tell(str(error))
        return 2
    except BrokenPipeError:  # whoever reads, such as `head`, has seen enough; nothing is left to flush at the exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def tell(sentence: str) -> None:
    """Say a sentence beside what is printed, in one line whatever names are in it."""
    print(f"workbench-runs: {printable(sentence)}", file=sys.stderr)


def _act(arguments: argparse.Namespace) -> int:
    if arguments.diff is not None:
        return _diff(*arguments.diff)
    if arguments.restore is not None:
        return _restore(arguments.restore)
    if arguments.changes is not None:
        return _changes(arguments.changes)
    if arguments.watch is not None:
        return _watch(arguments.watch)
    places, conditions = _read(arguments.query)
    found = sort(chosen(entries(*places), conditions), arguments.sort)
    columns = arguments.columns.split(",") if arguments.columns else None
    if arguments.view is not None:
        return _view(found if arguments.sort else best_first(found), arguments.view)
    if arguments.gallery or arguments.serve:
        from workbench.cli import gallery

        return gallery.show(found, serve=arguments.serve)
    if arguments.report:
        from workbench.cli import report  # here, as a query does without

        return report.main(_recordings(found))
    if arguments.rm:
        return _remove(found, places, arguments.yes)
    if arguments.json or arguments.csv:
        print(as_json(found) if arguments.json else as_csv(found, columns), end="\n" if arguments.json else "")
    elif arguments.sweeps:
        print(text(sweeps(found)))
    else:
        _list(found, columns, arguments.all)
    sys.stdout.flush()
    return 0


def _read(words: Sequence[str]) -> tuple[list[Path], list[Condition]]:
    """Tell conditions from places; without a place, where runs and sweeps go."""
    places, conditions = [], []
    for word in words:
        found = None if os.path.exists(word) else condition(word)
        if found is None:
            places.append(Path(word))
        else:
            conditions.append(found)
    usual = [place for place in map(Path, HOME) if place.is_dir()]
    if not places and not usual:
        raise InputError(f"expected {' or '.join(HOME)} here, or folders on the command line, found neither")
    return places or usual, conditions


def _list(found: Sequence[Entry], columns: Sequence[str] | None, every: bool) -> None:
    few = found if every else found[:FEW]
    if not few:
        print("no run fits")
        return
    print(text(table(few, columns)))
    if len(few) < len(found):
        print(f"and {len(found) - len(few)} more: --all, or a query that fits fewer")
    for entry in few:
        if entry.status == "unreadable":
            tell(entry.error)


def _recordings(found: Sequence[Entry]) -> list[str]:
    """The recordings of the runs, and those of runs that have ended since they were listed."""
    recordings = []
    for recording in (entry.recording for entry in found if entry.recording is not None):
        there = next(filter(os.path.exists, (recording, recording.removesuffix(".part"))), None)
        if there is None:
            tell(f"{recording}: left out, as it was removed meanwhile")
        else:
            recordings.append(there)
    recordings = [os.path.abspath(path) if path.startswith("-") else path for path in recordings]  # no option
    if not recordings:
        raise InputError("no run fits that has a recording")
    return recordings


def _view(found: Sequence[Entry], n: str) -> int:
    from workbench.cli import view  # here, as a query does without

    if n != "all" and not (n.isdecimal() and int(n)):
        raise InputError(f"--view: expected a number of runs or all, found {n!r}")
    return view.main(_recordings(found)[: None if n == "all" else int(n)])


def _diff(first: str, second: str) -> int:
    from workbench.results.difference import difference

    a, b = _one(first), _one(second)
    found = difference(a, b)
    print(f"A: {printable(a.path)}\nB: {printable(b.path)}")
    print(text(found) if found.rows else "nothing differs but where and when")
    return 0


def _one(place: str) -> Entry:
    """The run at a place; raises InputError where there is none, or several."""
    found = entries(Path(place))
    if len(found) != 1:
        raise InputError(f"{place}: expected one run, found {len(found)}")
    if found[0].status == "unreadable":
        raise InputError(found[0].error)
    return found[0]


def _restore(place: str) -> int:
    from workbench.recording.read.crash_probe import read_sound_run
    from workbench.results.restore import restore

    commands, gone = restore(read_sound_run(Path(_recordings([_one(place)])[0])), Path(__file__).parents[2])
    print("\n".join(commands))
    for sentence in gone:
        tell(sentence)
    return 0


def _changes(place: str) -> int:
    from workbench.recording.read.crash_probe import read_sound_run

    changes = str(read_sound_run(Path(_recordings([_one(place)])[0])).provenance.get("difference", ""))
    lines = changes.split("\n")
    print("\n".join(map(printable, lines)) if sys.stdout.isatty() else changes, end="")
    return 0


def _watch(place: Path) -> int:
    from workbench.sweep.table import watch

    try:
        return watch(place)
    except KeyboardInterrupt:
        return 130


def _remove(found: Sequence[Entry], places: Sequence[Path], yes: bool) -> int:
    """Delete runs, or without `yes` list them with their sizes."""
    from workbench.results import tidy

    if not found:
        raise InputError("no run fits")
    tidy.check_movable(found, places)
    if not yes:
        sizes = [tidy.bytes_of(entry) for entry in found]
        for entry, size in zip(found, sizes, strict=True):
            more = f": {printable(consequence)}" if (consequence := tidy.goes_with(entry)) else ""
            print(f"{_size(size):>9}  {printable(entry.status):<11}  {printable(entry.path)}{more}")
        print(f"{len(found)} runs, {_size(sum(sizes))}: would be removed; nothing was done, --yes does it")
        return 0
    from tqdm import tqdm

    removed = []
    for entry in tqdm(found, unit="run", disable=None):
        size, consequence = tidy.bytes_of(entry), tidy.goes_with(entry)
        try:
            tidy.remove(entry)
        except InputError as error:  # the other runs are removed all the same
            tell(str(error))
            continue
        removed.append(size)
        if consequence:
            tell(f"{entry.path}: {consequence}")
    print(f"{len(removed)} runs removed, {_size(sum(removed))} won")
    return 0 if len(removed) == len(found) else 2


def _size(n_bytes: int) -> str:
    return f"{n_bytes / 1e6:.1f} MB"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="workbench-runs", description=__doc__,
        epilog="example: workbench-runs prior=smooth 'error_abs_mm<40' 'started>2026-11-01' --sort error_abs_mm --view",
    )  # fmt: skip
    parser.add_argument(
        "query", metavar="FOLDER|key=value", nargs="*",
        help="where to look (recordings/runs and recordings/sweeps), and conditions: = != with values, commas between, "
        "< <= > >=, and ~ for a regular expression; keys are numbers, choices (prior), status, experiment, seed, "
        "started, commit, or a key of the configuration or how it ends",
    )  # fmt: skip
    parser.add_argument("--sort", metavar="KEY", help="smallest first; -KEY (as --sort=-KEY): largest first")
    parser.add_argument("--columns", metavar="KEY,…", help="what to show; varied: what tells the runs apart")
    parser.add_argument("--all", action="store_true", help=f"all rows, not the first {FEW}")
    parser.add_argument("--sweeps", action="store_true", help="a row for each sweep")
    parser.add_argument("--json", action="store_true", help="everything that is known of the runs")
    parser.add_argument("--csv", action="store_true", help="the columns, or all numbers")
    parser.add_argument("--view", metavar="N", nargs="?", const="1", help="open the best N (1), or all, in the viewer")
    parser.add_argument("--gallery", action="store_true", help="show them as cards in the viewer, with pictures")
    parser.add_argument(
        "--serve", action="store_true", help="as --gallery, but open no viewer: say what opens one, here and elsewhere"
    )
    parser.add_argument("--report", action="store_true", help="hand them to workbench-report")
    parser.add_argument("--diff", metavar=("A", "B"), nargs=2, help="what differs between two runs")
    parser.add_argument("--restore", metavar="RUN", help="the commands that bring a run's code and configuration back")
    parser.add_argument("--changes", metavar="RUN", help="how its code differed from its commit, for git apply")
    parser.add_argument("--watch", metavar="SWEEP", type=Path, help="follow a sweep started elsewhere until it is done")
    parser.add_argument("--rm", action="store_true", help="delete them; without --yes, list what would be deleted")
    parser.add_argument("--yes", action="store_true", help="with --rm: delete them")
    return parser


if __name__ == "__main__":
    sys.exit(main())
