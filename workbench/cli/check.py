"""workbench-check: do the configurations stored in recordings still give what was recorded?"""

import argparse
import os
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException
from tqdm import tqdm

from workbench.errors import InputError
from workbench.experiment.parts import name_parts, parts_in
from workbench.experiment.schema import prepare_hydra
from workbench.experiment.stored import (
    again,
    own_defaults,
    runnable,
    same_but_for_seeds,
    tolerances,
    with_other_seeds,
)
from workbench.files import whole_file
from workbench.recording.compare.compare import Finding, compare, compare_seeds, exactly_comparable
from workbench.recording.compare.condense import condense, is_condensed
from workbench.recording.compare.paired import compare_paired
from workbench.recording.compare.side_by_side import write_side_by_side
from workbench.recording.read.probe import fatal
from workbench.recording.read.reader import Run, find_recordings, read
from workbench.report.tables import Table, printable, text

_COLUMNS = ("recording", "metric", "was", "is", "tolerance", "verdict")
_NUMBERS = frozenset(("was", "is"))
REASONS = "reasons.md"
"""Beside renewed recordings: why they were."""


@dataclass(frozen=True, eq=False)
class Check:
    """One recording's outcome.

    refused: why it was not checked, where it was not. was, now: what was compared, where there are two recordings.
    """

    name: str
    findings: Sequence[Finding] = field(default_factory=tuple)
    refused: str | None = None
    was: Run | None = None
    now: Run | None = None

    @property
    def passed(self) -> bool:
        """Tell whether it was checked and nothing in it failed."""
        return self.refused is None and all(finding.passed for finding in self.findings)

    @property
    def unmoved(self) -> bool:
        """Tell whether it passed and every number is what it was."""
        return self.passed and not any(map(_moved, self.findings))


def main(argv: Sequence[str] | None = None) -> int:
    """Check recordings. Returns 0 when all passed, 1 when anything failed, 2 for bad input, 130 when interrupted."""
    arguments = _parser().parse_intermixed_args(argv)
    try:
        if arguments.seeds is not None and arguments.seeds < 2:
            raise InputError(f"--seeds: expected 2 or more, found {arguments.seeds}")
        if (arguments.seeds is not None or arguments.paired) and (arguments.update or arguments.record is not None):
            raise InputError("--seeds compares many runs with many: it goes with neither --update nor --record")
        if arguments.why is not None and not arguments.update:
            raise InputError("--why says why recordings are renewed: it goes with --update")
        if arguments.seeds is not None and arguments.paired:
            raise InputError("--paired takes the recorded seeds, --seeds others: say one of them")
        keep = arguments.keep
        with nullcontext(keep) if keep else TemporaryDirectory(prefix="workbench-check-") as folder:
            checks = _checks(arguments, Path(folder))
            print(moved(checks) if arguments.update else table(checks, arguments.verbose))
            code = _renew(checks, arguments.why) if arguments.update else exit_code(checks)
            if arguments.junit is not None:
                write_junit(arguments.junit, checks)
            if arguments.record is not None:
                _record(arguments.record, checks)
        return code
    except (InputError, HydraException, OmegaConfBaseException) as error:
        print(f"workbench-check: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("workbench-check: interrupted", file=sys.stderr)
        return 130


def _checks(arguments: argparse.Namespace, folder: Path) -> list[Check]:
    overrides = [text for text in arguments.what if _is_override(text)]
    name_parts(parts_in(overrides))
    overrides = [text for text in overrides if not text.startswith("parts=")]
    places = [Path(text) for text in arguments.what if not _is_override(text)]
    if not (paths := find_recordings(*places)):
        raise InputError(f"{', '.join(map(str, places)) or 'nowhere'}: expected recordings (.rrd), found none")
    runs, refused = _read(paths)
    pair = len(places) == 2 and all(place.is_file() for place in places)
    prepare_hydra()
    own = own_defaults(overrides)
    if pair and not (arguments.run or arguments.paired):
        if overrides or arguments.seeds or arguments.update:
            raise InputError("two recordings are compared without running; give --run to run each of them again")
        found = {run.path: run for run in runs}
        return refused or [_compared(f"{places[0]} → {places[1]}", found[places[0]], found[places[1]], own)]
    if arguments.paired:
        return refused + _paired(runs, overrides, own, folder)
    if arguments.seeds:
        return refused + _by_seeds(runs, overrides, own, arguments.seeds, folder)
    bar = tqdm(runs, unit="recording", disable=None)
    return refused + [_run_again(run, k, overrides, own, folder) for k, run in enumerate(bar)]


def _read(paths: Sequence[Path]) -> tuple[list[Run], list[Check]]:
    """The recordings, and those that cannot be read."""
    runs, refused, damaged = [], [], fatal(paths)
    for path in paths:
        try:
            if path in damaged:
                raise InputError(f"{path}: expected a whole recording, found damage that crashes whoever reads it")
            runs.append(read(path))
        except InputError as error:
            refused.append(Check(str(path), refused=str(error)))
    return runs, refused


def _compared(name: str, was: Run, now: Run, own: DictConfig) -> Check:
    try:
        return Check(name, compare(was, now, tolerances(was, own)), was=was, now=now)
    except InputError as error:
        return Check(name, refused=str(error))


def _run_again(was: Run, k: int, overrides: Sequence[str], own: DictConfig, folder: Path) -> Check:
    try:
        config = runnable(was, overrides, own)
    except InputError as error:
        return Check(str(was.path), refused=str(error))
    now = again(was, config, folder / f"{k:03d}")
    if isinstance(now, Finding):
        return Check(str(was.path), [now], was=was)
    return _compared(str(was.path), was, now, own)


def _by_seeds(runs: Sequence[Run], overrides: Sequence[str], own: DictConfig, n: int, folder: Path) -> list[Check]:
    """Groups of recordings that differ in their seeds, each against n runs with other seeds."""
    checks, groups = [], []
    for group in same_but_for_seeds(runs):
        try:
            groups.append((group, runnable(group[0], overrides, own)))
        except InputError as error:
            checks.append(Check(str(group[0].path), refused=str(error)))
    n_judged = sum(len(group[0].result) for group, _ in groups)
    for k, (group, config) in enumerate(groups):
        name = str(group[0].path) + (f" and {len(group) - 1} more" if len(group) > 1 else "")
        new = with_other_seeds(group, config, n, folder / f"{k:03d}")
        checks.append(Check(name, [new] if isinstance(new, Finding) else compare_seeds(group, new, n_judged)))
    return checks


def _paired(runs: Sequence[Run], overrides: Sequence[str], own: DictConfig, folder: Path) -> list[Check]:
    """Groups of recordings that differ in their seeds, each seed run again, judged by the differences."""
    groups = same_but_for_seeds([run for run in runs if run.status == "complete"])
    n_judged = sum(len(group[0].result) for group in groups)
    return [_pairs(group, overrides, own, folder / f"{k:03d}", n_judged) for k, group in enumerate(groups)]


def _pairs(group: Sequence[Run], overrides: Sequence[str], own: DictConfig, folder: Path, n_judged: int) -> Check:
    name = f"{group[0].path} and {len(group) - 1} more"
    if len(group) < 2:
        return Check(str(group[0].path), refused="--paired: expected recordings of two seeds or more, found one")
    new: list[Run] = []
    try:
        for run in tqdm(group, unit="seed", disable=None):
            now = again(run, runnable(run, overrides, own), folder / str(len(new)))
            if isinstance(now, Finding):
                return Check(name, [now])
            new.append(now)
    except InputError as error:
        return Check(name, refused=str(error))
    return Check(name, compare_paired(group, new, n_judged))


def _renew(checks: Sequence[Check], why: str | None) -> int:
    """Put what the runs came to in place of the recordings; the exit code. What was refused or crashed stays.

    So does, byte for byte, what came out the same and has no pictures: a recording kept with the code costs room in
    every version of it. why: goes into the file REASONS beside those whose numbers moved.
    """
    for check in checks:
        if check.refused is not None:
            print(f"{check.name}: stays as it is: {check.refused}", file=sys.stderr)
        elif check.was is None or check.now is None:
            print(f"{check.name}: stays as it is: {check.findings[0].detail}", file=sys.stderr)
        elif not (check.unmoved and exactly_comparable(check.was, check.now) and is_condensed(check.was)):
            with whole_file(check.was.path) as part:
                condense(check.now, part)
    if why is not None:
        _keep_reason([check for check in checks if check.now is not None and any(map(_moved, check.findings))], why)
    if any(check.refused is not None for check in checks):
        return 2
    return 1 if any(check.now is None for check in checks) else 0


def _keep_reason(moved: Sequence[Check], why: str) -> None:
    """Add a line to REASONS in every folder of the recordings whose numbers moved: the date, their names, and why."""
    names: dict[Path, list[str]] = {}
    for check in moved:
        if check.was is not None:
            names.setdefault(check.was.path.parent, []).append(check.was.path.stem)
    for folder, renewed in names.items():
        file = folder / REASONS
        before = file.read_text(encoding="utf-8") if file.is_file() else "# Why these recordings were renewed\n\n"
        with whole_file(file) as part:
            line = f"- {date.today()}: {', '.join(sorted(renewed))}: {' '.join(why.split())}\n"
            part.write_text(before + line, encoding="utf-8")


def _record(path: Path, checks: Sequence[Check]) -> None:
    """Both runs of the first recording that failed, or else of the first, in one recording."""
    pairs = sorted((check for check in checks if check.now is not None), key=lambda check: check.passed)
    if not pairs or pairs[0].was is None or pairs[0].now is None:
        raise InputError(f"{path}: expected two runs to show beside each other, found none")
    with whole_file(path) as part:
        write_side_by_side(part, pairs[0].was, pairs[0].now)
    print(f"{pairs[0].name}: look at both: rerun {os.path.relpath(path)}")


def exit_code(checks: Iterable[Check]) -> int:
    """2 when a recording was refused, else 1 when anything failed, else 0."""
    checks = list(checks)
    if any(check.refused is not None for check in checks):
        return 2
    return 0 if all(check.passed for check in checks) else 1


def table(checks: Sequence[Check], verbose: bool = False) -> str:
    """A row for every number that failed, and one for every recording that passed; verbose: for every number."""
    return text(Table(_COLUMNS, tuple(row for check in checks for row in _rows(check, verbose)), _NUMBERS))


def moved(checks: Sequence[Check]) -> str:
    """A row for every number that is not what it was."""
    rows = tuple((check.name, *_cells(finding)) for check in checks for finding in check.findings if _moved(finding))
    return text(Table(_COLUMNS, rows, _NUMBERS)) if rows else "nothing moved"


def _moved(finding: Finding) -> bool:
    return finding.was != finding.now or not finding.passed


def write_junit(path: Path, checks: Sequence[Check]) -> None:
    """A test suite with one test case for every number. Raises InputError when the file cannot be written."""
    cases = [(check, finding) for check in checks for finding in check.findings]
    failures = sum(not finding.passed for _, finding in cases)
    refused = [check for check in checks if check.refused is not None]
    counts = {"tests": str(len(cases) + len(refused)), "failures": str(failures), "errors": str(len(refused))}
    suite = ET.Element("testsuite", {"name": "workbench-check", **counts})
    for check, finding in cases:
        names = {"classname": printable(check.name), "name": printable(finding.quantity)}
        case = ET.SubElement(suite, "testcase", names)
        if not finding.passed:
            was, now, tolerance, verdict = map(printable, _cells(finding)[1:])
            ET.SubElement(case, "failure", {"message": f"was {was}, is {now}, tolerance {tolerance}: {verdict}"})
    for check in refused:
        case = ET.SubElement(suite, "testcase", {"classname": printable(check.name), "name": "recording"})
        ET.SubElement(case, "error", {"message": printable(check.refused or "")})
    with whole_file(path) as part:
        ET.ElementTree(suite).write(part, encoding="utf-8", xml_declaration=True)


def _rows(check: Check, verbose: bool) -> list[tuple[str, ...]]:
    if check.refused is not None:
        return [(check.name, "", "", "", "", f"REFUSED {check.refused}")]
    if check.passed and not verbose:
        tolerances = {finding.tolerance for finding in check.findings}
        tolerance = tolerances.pop() if len(tolerances) == 1 else "by metric"
        return [(check.name, f"all {len(check.findings)}", "", "", tolerance, "ok")]
    return [(check.name, *_cells(finding)) for finding in check.findings if verbose or not finding.passed]


def _cells(finding: Finding) -> tuple[str, ...]:
    was, now = ("" if value is None else f"{value:.6g}" for value in (finding.was, finding.now))
    verdict = "ok" if finding.passed else "FAILED"
    return finding.quantity, was, now, finding.tolerance, f"{verdict} {finding.detail}".rstrip()


def _is_override(text: str) -> bool:
    return "=" in text and not Path(text).exists()


def _parser() -> argparse.ArgumentParser:
    end = """Where version and platform are the same, everything must be equal bit for bit; elsewhere a number may move
        by what the recording's configuration allows it (check:)."""
    parser = argparse.ArgumentParser(prog="workbench-check", description=__doc__, epilog=end)
    parser.add_argument(
        "what", metavar="FOLDER|RUN.rrd|key=value", nargs="+",
        help="recordings to run again, and overrides such as paths.data=DATA; exactly two recordings are compared "
        "with each other, and nothing is run; parts=[my_parts] lets recordings build parts of that package",
    )  # fmt: skip
    parser.add_argument("--run", action="store_true", help="run again, also where exactly two recordings are given")
    parser.add_argument("--seeds", metavar="K", type=int, help="compare with K runs of other seeds, as distributions")
    parser.add_argument(
        "--paired", action="store_true", help="run the recorded seeds and judge the differences, run by run"
    )
    parser.add_argument("--update", action="store_true", help="put the new runs in place of the recordings")
    parser.add_argument("--why", metavar="REASON", help=f"with --update: kept in {REASONS} beside them")
    parser.add_argument("--record", metavar="DIFF.rrd", type=Path, help="write both runs beside each other")
    parser.add_argument("--junit", metavar="OUT.xml", type=Path, help="write the outcome for a build server")
    parser.add_argument("--keep", metavar="FOLDER", type=Path, help="keep the new runs there")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the numbers that passed, too")
    return parser


if __name__ == "__main__":
    sys.exit(main())
