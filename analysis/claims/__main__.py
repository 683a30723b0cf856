"""Test the claims of the papers' figures under the papers' own conditions, as published and as ours.

    python -m analysis.claims [NAME…] [--seeds N] [--paper literal|ours] [--runs FOLDER] [--data DATA] [--quick]
                              [-o FILE]

A NAME is a claim's or its beginning, such as C3 or D; none: all. The body, the camera and the initial pose are those
given to the tracker (dataset.perturb=false). Runs are cached in FOLDER/measured, so that interrupted work continues.
The exit code is 1 if a claim does not hold that should.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

from analysis import command
from analysis.claims.claim import Claim
from analysis.claims.listed import CLAIMS
from analysis.figures.cached_runs import RunCache
from analysis.figures.recordings import Source
from analysis.figures.replicates import PAPERS
from analysis.tables.table import markdown
from workbench.results.formatting import table_of, text
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

HOLDS, FAILS, EXCUSED, NOT_MEASURED = "holds", "does not hold", "does not hold, known", "not measured"
COLUMNS = ("claim", "version", "must hold", "measured", "verdict")


def row(claim: Claim, paper: str, source: Source, n_seeds: int | None, cache: RunCache) -> tuple[str, ...]:
    """Return a claim's row of the table, of COLUMNS."""
    try:
        results = [list(cache.results(runs).values()) for runs in claim.runs(paper, source, n_seeds)]
        verdict = claim.verdict(paper, source, results)
    except InputError as error:
        return claim.name, paper, claim.condition, str(error), NOT_MEASURED
    reason = claim.reasons.get(paper)
    outcome = HOLDS if verdict.holds else FAILS if reason is None else EXCUSED
    words = verdict.numbers if verdict.holds or reason is None else f"{verdict.numbers}: {reason}"
    return claim.name, paper, claim.condition, words, outcome


def rows(
    claims: Sequence[Claim], papers: Sequence[str], source: Source, n_seeds: int | None
) -> Iterator[tuple[str, ...]]:
    """Yield the rows of claims in their versions, as soon as each is measured."""
    cache, runs = RunCache(source.folder), []
    tested = [(claim, paper) for claim in claims for paper in papers if paper in claim.versions]
    for claim, paper in tested:
        try:
            runs += chain.from_iterable(claim.runs(paper, source, n_seeds))
        except InputError:
            continue  # the claim's row states it
    cache.expect(runs)
    for claim, paper in tested:
        yield row(claim, paper, source, n_seeds, cache)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return exit code 0, 1 if a claim does not hold that should, 2 for bad input."""
    parser = command.parser("analysis.claims", __doc__, "claims")
    parser.add_argument("--paper", choices=PAPERS, help="one version alone")
    parser.add_argument("--quick", action="store_true", help="small runs, with generated people where there is no DATA")
    parser.add_argument("-o", dest="file", type=Path, metavar="FILE", help="for the table in Markdown")
    options = parser.parse_args(arguments)
    source, measured = Source(options.runs, options.data, options.quick), []
    try:
        names = command.chosen(options.names, [claim.name for claim in CLAIMS])
        claims = [claim for claim in CLAIMS if claim.name in names]
        for each in rows(claims, [options.paper] if options.paper else PAPERS, source, options.seeds):
            measured.append(each)
            print(" · ".join(each), file=sys.stderr, flush=True)
    except InputError as error:
        print(f"claims: {error}", file=sys.stderr)
        return 2
    print(text(table_of(COLUMNS, measured)))
    if options.file is not None:
        with whole_file(options.file, parents=True) as part:
            part.write_text(markdown([COLUMNS, ["---"] * len(COLUMNS), *measured]), encoding="utf-8")
    return int(any(each[-1] == FAILS for each in measured))


if __name__ == "__main__":
    sys.exit(main())
