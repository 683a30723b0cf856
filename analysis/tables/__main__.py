"""Write the tables of numbers that the README and the pages show, as Markdown.

    python -m analysis.tables [NAME…] [--seeds N] [--stored] [--runs FOLDER] [--data DATA] [-o FOLDER]
    python -m analysis.tables videos --videos FOLDER [--detector MODEL] [--data DATA]
    python -m analysis.tables faults [--processes N] [--data DATA]
    python -m analysis.tables measures [--processes N] --data DATA
    python -m analysis.tables ankles --data DATA
    python -m analysis.tables methods --data DATA [--detector MODEL]

A NAME is a table's or its beginning, such as papers; none: all. Runs are cached in FOLDER/measured, so that interrupted
work continues; --stored runs nothing and shows a dash where runs are missing. Without -o the tables are written where
the pages include them, and the text between the markers of README.md is replaced.
"""

import os
import re
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path

from analysis import command
from analysis.figures.cached_runs import RunCache
from analysis.figures.recordings import Source
from analysis.tables import ankles, cameras, faults, measures, methods, videos
from analysis.tables.listed import TABLES
from analysis.tables.table import Table
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

ROOT = Path(__file__).parents[2]
FOLDER, README = ROOT / "docs" / "_tables", ROOT / "README.md"
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
_INCLUDED = re.compile(r"(?:\{include\} _tables/|<!-- table: )(\w+)")


def _data(options: Namespace) -> Path | None:
    return None if options.data is None else Path(options.data)


MEASURED: Mapping[str, Callable[[Namespace], str]] = {
    "videos": lambda options: videos.table(options.videos, _data(options), options.runs / "videos", options.detector),
    "cameras": lambda options: cameras.table(options.seeds or cameras.N_SCENES),
    "faults": lambda options: faults.table(_data(options), options.processes),
    "measures": lambda options: measures.table(_data(options), options.processes, options.seeds or measures.N_WALKS),
    "ankles": lambda options: ankles.table(_data(options)),
    "methods": lambda options: methods.table(_data(options), options.detector),
}
"""Tables without recorded runs, by the command's options."""


def included() -> set[str]:
    """Return the names of the tables that the README and the pages show."""
    pages = (README, *FOLDER.parent.rglob("*.md"))
    return {name for page in pages for name in _INCLUDED.findall(page.read_text(encoding="utf-8"))}


def with_tables(page: str, texts: Mapping[str, str]) -> str:
    """Return a page with the tables between its markers replaced by those of these names."""
    return _MARKED.sub(lambda found: f"{found[1]}{texts[found[2]]}{found[3]}" if found[2] in texts else found[0], page)


def write(folder: Path, name: str, text: str) -> None:
    """Write a table, and where the pages include it also into README.md."""
    with whole_file(folder / f"{name}.md", parents=True) as part:
        part.write_text(text, encoding="utf-8")
    if folder == FOLDER:
        page = README.read_text(encoding="utf-8")
        with whole_file(README) as part:
            part.write_text(with_tables(page, {name: text}), encoding="utf-8")


def make(tables: Mapping[str, Table], source: Source, n_seeds: int | None, stored: bool, folder: Path) -> list[str]:
    """Make and write tables; return a message for each that is not possible."""
    cache, rows, failed = RunCache(source.folder), {}, []
    for name, table in tables.items():
        try:
            rows[name] = table.rows(source, n_seeds)
        except InputError as error:
            failed.append(f"{name}: {error}")
    if not stored:
        cache.expect(chain.from_iterable(chain.from_iterable(each.values()) for each in rows.values()))
    for name, each in rows.items():
        try:
            results = {
                labels: {run: cache.cached(run) for run in runs} if stored else cache.results(runs)
                for labels, runs in each.items()
            }
            write(folder, name, tables[name].text(results))
        except InputError as error:
            failed.append(f"{name}: {error}")
    return failed


def main(arguments: Sequence[str] | None = None) -> int:
    """Return exit code 0, 1 if a table could not be made, 2 for bad input."""
    parser = command.parser("analysis.tables", __doc__, "tables")
    parser.add_argument("--stored", action="store_true", help="run nothing")
    parser.add_argument("-o", dest="folder", type=Path, default=FOLDER, help="for the files (docs/_tables)")
    parser.add_argument("--videos", type=Path, metavar="FOLDER", help="of annotated videos, for the table videos")
    parser.add_argument(
        "--detector", default="full", help="of the tables videos and methods: full, heavy or a model (full)"
    )
    parser.add_argument(
        "--processes", type=int, default=os.cpu_count(), metavar="N", help="of the tables faults and measures (cores)"
    )
    options = parser.parse_args(arguments)
    try:
        source = Source(options.runs, options.data, quick=False)
        names = command.chosen(options.names, [*TABLES, *MEASURED])
        tables = {name: TABLES[name] for name in names if name in TABLES}
        failed = make(tables, source, options.seeds, options.stored, options.folder)
        for name in (each for each in names if each in MEASURED and not options.stored):
            try:
                write(options.folder, name, MEASURED[name](options))
            except InputError as error:
                failed.append(f"{name}: {error}")
    except InputError as error:
        print(f"tables: {error}", file=sys.stderr)
        return 2
    for message in failed:
        print(f"not made: {message}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
