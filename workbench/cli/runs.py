"""List, compare, view, restore and delete recorded runs.

Examples:
  workbench runs list experiment=walk_straight
  workbench runs diff recordings/sweeps/priors/3 recordings/sweeps/priors/13
"""

import json
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from workbench.results.diff import diff as difference
from workbench.results.formatting import text
from workbench.results.query import best_first, listing, parse_condition, select, sort_runs, sweeps
from workbench.results.table import read_runs, records_of
from workbench.utils.errors import InputError
from workbench.utils.text import printable

HOME = ("recordings/runs", "recordings/sweeps")
_N_ROWS = 40

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__)

_Query = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="FOLDER|KEY=VALUE", show_default=False,
        help="Folders (default: recordings/runs, recordings/sweeps), and conditions: = != with values, separated by "
        "commas, < <= > >=, and ~ with a regular expression. Keys are metrics, choices (prior), status, experiment, "
        "seed, started, commit, or a configuration key or its last part.",
    ),
]  # fmt: skip
Run = Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder or recording.")]
Sort = Annotated[str | None, typer.Option("--sort", metavar="KEY", help="Ascending; -KEY: descending.")]


@app.command("list")
def _list_runs(
    query: _Query = None,
    sort: Sort = None,
    columns: Annotated[
        str | None, typer.Option(metavar="KEY,…", help="Columns; varied: the differing configuration keys.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help=f"Print all rows; default: the first {_N_ROWS}.")] = False,
    by_sweep: Annotated[bool, typer.Option("--sweeps", help="One row for each sweep.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print all fields of the runs as JSON.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the columns, or all metrics, as CSV.")] = False,
    n_best: Annotated[
        int | None, typer.Option("--view", metavar="N", min=1, max=2, help="Open the best one or two in the viewer.")
    ] = None,
    as_report: Annotated[bool, typer.Option("--report", help="Report on the runs, as workbench report.")] = False,
) -> None:
    """List runs, newest first, with status, differences and errors.

    Examples:
      workbench runs list experiment=walk_straight 'mpjpe_px<9' --sort mpjpe_px
      workbench runs list prior=smooth 'started>2026-11-01' --columns varied,seed,mpjpe_abs_mm --csv
    """
    runs = sort_runs(_select(query)[0], sort)
    names = columns.split(",") if columns else None
    if n_best is not None:
        from workbench.cli.view import view

        view(_recordings(runs if sort else best_first(runs))[:n_best])
    elif as_report:
        from workbench.cli.report import report

        report(_recordings(runs))
    elif as_json:
        print(json.dumps(records_of(runs), indent=1))
    elif as_csv:
        numbers = sorted(name.removeprefix("metrics.") for name in runs if name.startswith("metrics."))
        names = names or ["path", "started", "status", "experiment", "seed", *numbers]
        listing(runs, names).to_csv(sys.stdout, index=False)
    elif by_sweep:
        print(text(sweeps(runs)))
    elif runs.empty:
        print("no matching run")
    else:
        listed = runs if every else runs[:_N_ROWS]
        print(text(listing(listed, names), longest=80))
        if len(listed) < len(runs):
            print(f"and {len(runs) - len(listed)} more: use --all or a narrower query")
        for error in listed["error"][listed["status"] == "unreadable"]:
            _warn(error)


@app.command()
def diff(first: Run, second: Run) -> None:
    """Compare the configuration, the code and the results of two runs.

    Examples:
      workbench runs diff recordings/sweeps/priors/3 recordings/sweeps/priors/13
      workbench runs diff recordings/runs/walk_straight/TIME recordings/baselines/walk_straight.rrd
    """
    a, b = (records_of(_one(place))[0] for place in (first, second))
    rows = difference(a, b)
    print(f"A: {printable(a['path'])}\nB: {printable(b['path'])}")
    print("no differences except location and time" if rows.empty else text(rows))


@app.command()
def compare(
    first: Annotated[str, typer.Argument(metavar="A", help="A folder of runs, or conditions as of runs list.")],
    second: Annotated[str, typer.Argument(metavar="B", help="The same of the other configuration.")],
    query: _Query = None,
    latex: Annotated[bool, typer.Option("--latex", help="Print the table as LaTeX.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the table as CSV.")] = False,
) -> None:
    """Compare the results of two configurations in pairs of equal people, clips and seeds.

    Each metric has the mean difference with a 90 % interval over people and their runs, the number of pairs in which
    B is better, the effect size, and whether the difference is significant (Holm).

    Examples:
      workbench runs compare recordings/sweeps/before recordings/sweeps/after
      workbench runs compare prior=walking prior=smooth recordings/sweeps/priors inference.n_particles=5000
    """
    from workbench.recording.read.crash_probe import open_sound_runs
    from workbench.results.report.pairs import paired_table

    (a, unreadable_a), (b, unreadable_b) = (
        open_sound_runs(
            *_recordings(_select([*([words] if os.path.exists(words) else words.split()), *(query or [])])[0])
        )
        for words in (first, second)
    )
    table = paired_table(a, b, [*unreadable_a, *unreadable_b])
    if as_csv:
        table.to_csv(sys.stdout, index=False)
    elif latex:
        print(table.to_latex(index=False, escape=True, float_format="%.4g"), end="")
    else:
        print(f"A: {first}\nB: {second}\n{text(table.astype(object))}")


@app.command()
def restore(
    run: Run,
    changes: Annotated[
        bool, typer.Option("--changes", help="Print the difference of its code, for git apply.")
    ] = False,
) -> None:
    """Print the commands that restore a run's code and configuration.

    Examples:
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
    for message in missing:
        _warn(message)


@app.command()
def watch(sweep: Annotated[Path, typer.Argument(help="The sweep's folder.")]) -> None:
    """Follow a sweep of another process until its jobs have ended.

    Examples:
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
    yes: Annotated[bool, typer.Option("--yes", help="Delete the runs; without it, only list them.")] = False,
) -> None:
    """Delete runs, or list the runs that would be deleted.

    Examples:
      workbench runs rm status=failed
      workbench runs rm status=failed 'started<2026-11-01' --yes
    """
    from workbench.experiment.summary import earlier_runs
    from workbench.results.removal import check_removable, remove, size_of

    runs, places = _select(query)
    if runs.empty:
        raise InputError("no matching run")
    check_removable(runs, places)
    sizes = []
    for path, status, started in zip(map(Path, runs["path"]), runs["status"], runs["started"], strict=True):
        size, earlier = size_of(path), earlier_runs(path)
        if yes:
            try:
                remove(path, started)
            except InputError as error:  # the other runs are still removed
                _warn(str(error))
                continue
        sizes.append(size)
        place = f"{path}: the earlier run {earlier[-1]} is restored" if earlier else str(path)
        print(f"{size / 1e6:>6.1f} MB  {printable(status):<11}  {printable(place)}")
    done = "removed" if yes else "would be removed; --yes removes them"
    print(f"{len(sizes)} runs, {sum(sizes) / 1e6:.1f} MB: {done}")
    if len(sizes) < len(runs):
        raise typer.Exit(2)


def _select(query: Sequence[str] | None) -> tuple[pd.DataFrame, list[Path]]:
    """Return the runs of a query and the searched folders."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may not be valid text
    words = {word: None if os.path.exists(word) else parse_condition(word) for word in query or []}
    places = [Path(word) for word, condition in words.items() if condition is None]
    places = places or [place for place in map(Path, HOME) if place.is_dir()]
    if not places:
        raise InputError(f"expected {' or '.join(HOME)} in this folder, or folders as arguments, found neither")
    return select(read_runs(*places), filter(None, words.values())), places


def _one(place: Path) -> pd.DataFrame:
    runs = read_runs(place)
    if len(runs) != 1:
        raise InputError(f"{place}: expected one run, found {len(runs)}")
    if runs["status"].iloc[0] == "unreadable":
        raise InputError(runs["error"].iloc[0])
    return runs


def _recordings(runs: pd.DataFrame) -> list[Path]:
    """Return the recordings of the runs, including runs that have ended since the query."""
    recordings = []
    for recording in runs["recording"].dropna():
        path = next(filter(os.path.exists, (recording, recording.removesuffix(".part"))), None)
        if path is None:
            _warn(f"{recording}: omitted, as it was removed")
        else:
            recordings.append(Path(os.path.abspath(path) if path.startswith("-") else path))  # not an option
    if not recordings:
        raise InputError("no matching run with a recording")
    return recordings


def _warn(message: str) -> None:
    print(f"workbench runs: {printable(message)}", file=sys.stderr)
