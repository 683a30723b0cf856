"""workbench-check: do the configurations stored in recordings still give what was recorded?"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from workbench.cli.hydra_quoting import quoted
from workbench.cli.run_output import tell_warnings
from workbench.experiment.branch import changes
from workbench.experiment.config.options import name_parts, parts_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import own_defaults
from workbench.recording.read.reader import find_recordings
from workbench.recording.side_by_side import write_side_by_side
from workbench.results.check.against import check_against
from workbench.results.check.outcome import Check, exit_code, moved, notes, table, write_junit
from workbench.results.check.renewal import REASONS, renew
from workbench.results.check.rerun import Request, check_each, check_paired, check_seeds, check_two, read_sound
from workbench.results.formatting import printable
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError, shortened
from workbench.utils.signals import Interrupted, interruptible

MANY = ("seeds", "paired", "against")
"""Options that run recordings several times; one of them at a time."""


def main(argv: Sequence[str] | None = None) -> int:
    """Check recordings. Returns 0 when all passed, 1 when anything failed, 2 for bad input, 128 + n by signal n."""
    arguments = _parser().parse_intermixed_args(argv)
    tell_warnings()
    with interruptible():
        return _main(arguments)


def _main(arguments: argparse.Namespace) -> int:
    try:
        _refuse_nonsense(arguments)
        keep = arguments.keep
        with nullcontext(keep) if keep else TemporaryDirectory(prefix="workbench-check-") as folder:
            return _check(arguments, Path(folder))
    except (InputError, HydraException, OmegaConfBaseException) as error:
        print(f"workbench-check: {shortened(' '.join(str(error).split()))}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads, such as `head`, has seen enough; nothing is left to flush at the exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Interrupted as error:
        print(f"workbench-check: interrupted by {error}", file=sys.stderr)
        return 128 + error.number


def _refuse_nonsense(arguments: argparse.Namespace) -> None:
    said = [name for name in MANY if getattr(arguments, name) not in (None, False)]
    if len(said) > 1:
        raise InputError(f"--{said[0]} and --{said[1]}: say one of them")
    if arguments.seeds is not None and arguments.seeds < 2:
        raise InputError(f"--seeds: expected 2 or more, found {arguments.seeds}")
    if said and (arguments.update or arguments.record is not None):
        raise InputError(f"--{said[0]} goes with neither --update nor --record")
    if arguments.why is not None and not arguments.update:
        raise InputError("--why says why recordings are renewed: it goes with --update")
    if arguments.exact and (arguments.seeds is not None or arguments.paired):
        raise InputError("--exact asks for identical numbers: it goes with neither --seeds nor --paired")


def _check(arguments: argparse.Namespace, folder: Path) -> int:
    checks = _checks(arguments, folder)
    print(moved(checks) if arguments.update else table(checks, arguments.verbose), flush=True)
    for line in notes(checks):
        print(line, flush=True)
    code = renew(checks, arguments.why) if arguments.update else exit_code(checks)
    if arguments.junit is not None:
        write_junit(arguments.junit, checks)
    if arguments.record is not None:
        _record(arguments.record, checks)
    return code


def _checks(arguments: argparse.Namespace, folder: Path) -> list[Check]:
    """What the checks came to."""
    overrides = [text for text in arguments.what if _is_override(text)]
    name_parts(parts_in(overrides))
    overrides = [quoted(text) for text in overrides if not text.startswith("parts=")]
    places = [Path(text) for text in arguments.what if not _is_override(text)]
    if not (paths := find_recordings(*places)):
        raise InputError(f"{', '.join(map(str, places)) or 'nowhere'}: expected recordings (.rrd), found none")
    runs, refused = read_sound(paths)
    prepare_hydra()
    request = Request(overrides, own_defaults(overrides), folder, arguments.exact)
    if arguments.paired and any(each.startswith("seed=") for each in overrides):
        raise InputError("seed= would part the pairs: they take the recorded seeds")
    many = any(getattr(arguments, name) for name in MANY)
    if len(places) == 2 and all(place.is_file() for place in places) and not (arguments.run or many):
        if overrides or arguments.update:
            raise InputError("two recordings are compared without running; give --run to run each of them again")
        found = {run.path: run for run in runs}
        if not refused:
            _tell_differences(*(found[place].settings for place in places))
        return refused or [check_two(f"{places[0]} → {places[1]}", found[places[0]], found[places[1]], request)]
    if arguments.paired:
        return refused + check_paired(runs, request)
    if arguments.against is not None:
        return refused + check_against(runs, request, arguments.against)
    if arguments.seeds is not None:
        return refused + check_seeds(runs, request, arguments.seeds)
    return refused + list(check_each(runs, request))


def _tell_differences(was: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Say which keys of two configurations differ."""
    if found := changes(was, now):
        print("\n".join(["configured otherwise:", *(f"  {printable(each)}" for each in found)]))


def _record(path: Path, checks: Sequence[Check]) -> None:
    """Both runs of the first recording that failed, or else of the first, in one recording."""
    pairs = sorted((check for check in checks if check.now is not None), key=lambda check: check.passed)
    if not pairs or pairs[0].was is None or pairs[0].now is None:
        raise InputError(f"{path}: expected two runs to show beside each other, found none")
    with whole_file(path) as part:
        write_side_by_side(part, pairs[0].was, pairs[0].now)
    print(f"{pairs[0].name}: look at both: rerun {os.path.relpath(path)}")


def _is_override(text: str) -> bool:
    return "=" in text and not Path(text).exists()


def _parser() -> argparse.ArgumentParser:
    end = """In the environment that a recording was made in, numbers must be equal to rounding; in another one they
        must be within measured tolerances, or what the recording's configuration allows (check:)."""
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
    parser.add_argument(
        "--against", metavar="REV", help="compare this code with that of another commit on this machine, to rounding"
    )
    parser.add_argument("--exact", action="store_true", help="ask for identical numbers: rounding fails, too")
    parser.add_argument("--update", action="store_true", help="put the new runs in place of the recordings")
    parser.add_argument("--why", metavar="REASON", help=f"with --update: kept in {REASONS} beside them")
    parser.add_argument("--record", metavar="DIFF.rrd", type=Path, help="write both runs beside each other")
    parser.add_argument("--junit", metavar="OUT.xml", type=Path, help="write the outcome for a build server")
    parser.add_argument("--keep", metavar="FOLDER", type=Path, help="keep the new runs there")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the numbers that passed, too")
    return parser


if __name__ == "__main__":
    sys.exit(main())
