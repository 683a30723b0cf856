"""Write the size of recordings per frame by path as a table in Markdown.

    python -m analysis.recording_sizes NAME=RUN.rrd… [-o FILE]

A NAME heads the column of its recording. Values are sizes in memory, which Rerun compresses in the file.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import workbench as wb
from analysis.tables.table import NONE, markdown
from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

GROUPS = ("particles", "estimate", "truth", "posterior", "coefficients", "metrics", "video", "image")
"""Names in entity paths; a path belongs to the first of these groups that it contains."""
OTHER, FILE = "all others", "file"


def group(path: str) -> str:
    """Return the group of an entity path."""
    return next((name for name in GROUPS if name in path.split("/")), OTHER)


def sizes(recording: Path) -> dict[str, float]:
    """Return kB per frame of every recorded group and of the file; raises InputError for a recording without frames."""
    frames, _ = wb.read(recording).poses
    if not len(frames):
        raise InputError(f"{recording}: expected a run with recorded frames, found none")
    counts: Counter[str] = Counter({FILE: recording.stat().st_size})
    for chunk in read_chunks(recording, EVERYTHING):
        counts[group(chunk.entity_path)] += chunk.to_record_batch().nbytes
    return {name: 1e-3 * n_bytes / len(frames) for name, n_bytes in counts.items()}


def table(columns: Mapping[str, Mapping[str, float]]) -> str:
    """Return the table of `sizes` by the names of the columns."""
    lines = [["kB per frame", *columns], ["---"] * (1 + len(columns))]
    for name in (*GROUPS, OTHER, FILE):
        cells = (column.get(name) for column in columns.values())
        lines.append([f"`{name}`" if name in GROUPS else name, *(NONE if c is None else f"{c:.1f}" for c in cells)])
    return markdown(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return exit code 0, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m analysis.recording_sizes", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("recordings", nargs="+", metavar="NAME=RUN.rrd")
    parser.add_argument("-o", dest="file", type=Path, help="write the table here; none: print it")
    options = parser.parse_args(arguments)
    try:
        columns = {}
        for name, equals, path in (each.partition("=") for each in options.recordings):
            if not equals or not Path(path).is_file():
                raise InputError(f"expected NAME=RUN.rrd with an existing recording, found {name}{equals}{path}")
            columns[name] = sizes(Path(path))
        if options.file is None:
            print(table(columns), end="")
        else:
            with whole_file(options.file) as part:
                part.write_text(table(columns), encoding="utf-8")
    except InputError as error:
        print(f"recording_sizes: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
