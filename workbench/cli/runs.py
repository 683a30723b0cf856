"""Recorded runs: list, compare, view, restore and delete them."""

import json
import os
import platform
import signal
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

import pandas as pd
import typer

from workbench.results.diff import diff as difference
from workbench.results.formatting import printable, text
from workbench.results.query import best_first, listing, parse_condition, select, sort_runs, sweeps
from workbench.results.table import read_runs, records_of
from workbench.utils import processes
from workbench.utils.errors import InputError

HOME = ("recordings/runs", "recordings/sweeps")
_N_ROWS = 40

app = typer.Typer(no_args_is_help=True, help=__doc__)

_Query = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="FOLDER|KEY=VALUE", show_default=False,
        help="Folders (recordings/runs and recordings/sweeps), and conditions: = != with values, commas between them, "
        "< <= > >=, and ~ for a regular expression. Keys are numbers, choices (prior), status, experiment, seed, "
        "started, commit, or a key of the configuration or its end.",
    ),
]  # fmt: skip
Run = Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder or recording.")]
Sort = Annotated[str | None, typer.Option("--sort", metavar="KEY", help="Smallest first; -KEY: largest first.")]


@app.command("list")
def _list_runs(
    query: _Query = None,
    sort: Sort = None,
    columns: Annotated[
        str | None, typer.Option(metavar="KEY,…", help="Columns; varied: how the configurations differ.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help=f"All rows, not the first {_N_ROWS}.")] = False,
    by_sweep: Annotated[bool, typer.Option("--sweeps", help="A row for each sweep.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="All that is known of the runs, as JSON.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="The columns, or all numbers, as CSV.")] = False,
    n_best: Annotated[int | None, typer.Option("--view", metavar="N", min=0, help="View the best N; 0: all.")] = None,
    as_report: Annotated[bool, typer.Option("--report", help="Report on them, as workbench report does.")] = False,
) -> None:
    """List runs, newest first, with how they ended, what varied and their errors.

    workbench runs list experiment=walk_straight 'mpjpe_px<9' --sort mpjpe_px
    workbench runs list prior=smooth 'started>2026-11-01' --columns varied,seed,mpjpe_abs_mm --csv
    """
    found = sort_runs(_select(query)[0], sort)
    names = columns.split(",") if columns else None
    if n_best is not None:
        from workbench.cli.view import view

        view(_recordings(found if sort else best_first(found))[: n_best or None])
    elif as_report:
        from workbench.cli.report import report

        report(_recordings(found))
    elif as_json:
        print(json.dumps(records_of(found), indent=1))
    elif as_csv:
        numbers = sorted(name.removeprefix("metrics.") for name in found if name.startswith("metrics."))
        names = names or ["path", "started", "status", "experiment", "seed", *numbers]
        listing(found, names).to_csv(sys.stdout, index=False)
    elif by_sweep:
        print(text(sweeps(found)))
    elif found.empty:
        print("no run fits")
    else:
        few = found if every else found[:_N_ROWS]
        print(text(listing(few, names), longest=80))
        if len(few) < len(found):
            print(f"and {len(found) - len(few)} more: --all, or a query that fits fewer")
        for error in few["error"][few["status"] == "unreadable"]:
            _warn(error)


@app.command()
def diff(first: Run, second: Run) -> None:
    """Compare the configuration, the code and the results of two runs.

    workbench runs diff recordings/sweeps/priors/3 recordings/sweeps/priors/13
    workbench runs diff recordings/runs/walk_straight/TIME recordings/baselines/walk_straight.rrd
    """
    a, b = (records_of(_one(place))[0] for place in (first, second))
    rows = difference(a, b)
    print(f"A: {printable(a['path'])}\nB: {printable(b['path'])}")
    print("nothing differs but where and when" if rows.empty else text(rows))


@app.command()
def gallery(
    query: _Query = None,
    sort: Sort = None,
    serve: Annotated[bool, typer.Option("--serve", help="Open no viewer: print what opens one.")] = False,
) -> None:
    """Show runs as cards with pictures in the viewer.

    workbench runs gallery recordings/sweeps/priors
    workbench runs gallery prior=walking --sort mpjpe_px --serve
    """
    from workbench.cli.view import viewer
    from workbench.recording.write.file import HOST
    from workbench.results.gallery import gallery

    program = None if serve else viewer()
    try:
        with gallery(sort_runs(_select(query)[0], sort)) as served:
            for sentence in served.left_out:
                _warn(sentence)
            print(f"{served.n_runs} runs as cards at {served.url}", flush=True)
            if program is None:
                port, command = urlsplit(served.url).port, f"rerun --bind {HOST} '{served.url}'"
                print(f"on this machine: {command}")
                print(f"elsewhere: ssh -N -L {port}:{HOST}:{port} {platform.node()}, and there the same {command}")
                print("until this is interrupted (Ctrl-C)", flush=True)
                signal.pause()
            code = processes.run([str(program), "--bind", HOST, "--port", "auto", served.url]).returncode
    except KeyboardInterrupt:
        raise typer.Exit(0 if serve else 130) from None
    if code:
        _warn(f"the viewer ended with exit code {code}; --serve prints what opens it from another machine")
        raise typer.Exit(1)


@app.command()
def restore(
    run: Run,
    changes: Annotated[bool, typer.Option("--changes", help="Print its change of the code, for git apply.")] = False,
) -> None:
    """Print the commands that restore a run's code and configuration.

    workbench runs restore recordings/sweeps/priors/3
    workbench runs restore --changes recordings/sweeps/priors/3 | git apply
    """
    from workbench.recording.read.crash_probe import read_sound_run
    from workbench.results.restore import restore

    recorded = read_sound_run(Path(_recordings(_one(run))[0]))
    if changes:
        lines = str(recorded.provenance.get("difference", "")).split("\n")
        print("\n".join(map(printable, lines) if sys.stdout.isatty() else lines), end="")
        return
    commands, missing = restore(recorded, Path(__file__).parents[2])
    print("\n".join(commands))
    for sentence in missing:
        _warn(sentence)


@app.command()
def watch(sweep: Annotated[Path, typer.Argument(help="The sweep's folder.")]) -> None:
    """Follow a sweep that another process runs until its jobs have ended.

    workbench runs watch recordings/sweeps/priors
    workbench runs watch recordings/sweeps/walk_straight/TIME
    """
    from workbench.sweep.table import watch

    try:
        raise typer.Exit(watch(sweep))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


@app.command()
def rm(
    query: _Query = None,
    yes: Annotated[bool, typer.Option("--yes", help="Delete them; without it, only list them.")] = False,
) -> None:
    """Delete runs, or list what would be deleted.

    workbench runs rm status=failed
    workbench runs rm status=failed 'started<2026-11-01' --yes
    """
    from workbench.results.removal import check_removable, consequence, remove, size_of

    found, places = _select(query)
    if found.empty:
        raise InputError("no run fits")
    check_removable(found, places)
    sizes = []
    for path, status, started in zip(map(Path, found["path"]), found["status"], found["started"], strict=True):
        size, more = size_of(path), consequence(path)
        if yes:
            try:
                remove(path, started)
            except InputError as error:  # the other runs are removed all the same
                _warn(str(error))
                continue
        sizes.append(size)
        print(f"{size / 1e6:>6.1f} MB  {printable(status):<11}  {printable(f'{path}: {more}' if more else str(path))}")
    done = "removed" if yes else "would be removed; nothing was done, --yes does it"
    print(f"{len(sizes)} runs, {sum(sizes) / 1e6:.1f} MB: {done}")
    if len(sizes) < len(found):
        raise typer.Exit(2)


def _select(query: Sequence[str] | None) -> tuple[pd.DataFrame, list[Path]]:
    """Return the runs that a query selects, and the places where it searched."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file's name may be no text at all
    words = {word: None if os.path.exists(word) else parse_condition(word) for word in query or []}
    places = [Path(word) for word, condition in words.items() if condition is None]
    places = places or [place for place in map(Path, HOME) if place.is_dir()]
    if not places:
        raise InputError(f"expected {' or '.join(HOME)} here, or folders on the command line, found neither")
    return select(read_runs(*places), filter(None, words.values())), places


def _one(place: Path) -> pd.DataFrame:
    runs = read_runs(place)
    if len(runs) != 1:
        raise InputError(f"{place}: expected one run, found {len(runs)}")
    if runs["status"].iloc[0] == "unreadable":
        raise InputError(runs["error"].iloc[0])
    return runs


def _recordings(runs: pd.DataFrame) -> list[Path]:
    """Return the recordings of the runs, also of runs that have ended since they were listed."""
    recordings = []
    for recording in runs["recording"].dropna():
        there = next(filter(os.path.exists, (recording, recording.removesuffix(".part"))), None)
        if there is None:
            _warn(f"{recording}: left out, as it was removed meanwhile")
        else:
            recordings.append(Path(os.path.abspath(there) if there.startswith("-") else there))  # which is no option
    if not recordings:
        raise InputError("no run fits that has a recording")
    return recordings


def _warn(sentence: str) -> None:
    print(f"workbench runs: {printable(sentence)}", file=sys.stderr)
