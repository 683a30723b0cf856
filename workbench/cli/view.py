"""workbench-view: open recordings in the viewer; two are shown beside each other, more with their curves overlaid."""

import argparse
import platform
import shutil
import socket
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from workbench.recording.overlaid import NAME, write_overlaid
from workbench.recording.read.chunks import HEAD, end_of_whole
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.recording.side_by_side import write_names, write_side_by_side
from workbench.recording.write.file import HOST
from workbench.results.report.variation import flat, label, what_varied
from workbench.utils import processes
from workbench.utils.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Open recordings and wait until the viewer is closed.

    Returns 0, 1 when the viewer failed, 2 when there is nothing to open or no viewer, 130 when interrupted.
    """
    parser = argparse.ArgumentParser(prog="workbench-view", description=__doc__)
    parser.add_argument(
        "recordings", metavar="RUN|FOLDER", type=Path, nargs="+",
        help="recordings, or folders with recordings; exactly two recordings are compared",
    )  # fmt: skip
    parser.add_argument(
        "--web", action="store_true", help="for a browser, on a server too: says what to open and how to forward it"
    )
    arguments = parser.parse_args(argv)
    places: list[Path] = arguments.recordings
    try:
        program = viewer()
        runs = _readable(places)
        pair = len(places) == len(runs) == 2 and all(place.is_file() for place in places)
        with TemporaryDirectory(prefix="workbench-view-") as folder:  # kept as long as the viewer is open
            files = _beside(runs, places, Path(folder)) if pair else _together(runs, Path(folder))
            code = show([str(program), "--bind", HOST, *_ports(arguments.web)], files)
        if code:
            print(f"workbench-view: the viewer ended with exit code {code}", file=sys.stderr)
        return 1 if code else 0
    except InputError as error:
        print(f"workbench-view: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def show(command: Sequence[str], files: Sequence[Path]) -> int:
    """Open recordings in the viewer, which shows the last of them, and wait until it is closed; returns its exit code.

    Several go through a pipe one after the other: it reads files at once, and shows whichever it has read last.
    """
    if len(files) == 1:
        return processes.run([*command, str(files[0])]).returncode
    with processes.start([*command, "-"]) as process:
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # the viewer was closed meanwhile
            for path in files:
                with path.open("rb") as file:
                    end = end_of_whole(file, HEAD) if path.suffix == ".part" else path.stat().st_size
                    file.seek(0)
                    process.stdin.write(file.read(end))
            process.stdin.close()
        return process.wait()


def _ports(web: bool) -> list[str]:
    """Where the viewer listens; of one in a browser, said with what opens it from here and from elsewhere."""
    if not web:
        return ["--port", "auto"]
    page, data = _free_ports(2)
    address = f"http://{HOST}:{page}/?url=rerun%2Bhttp://{HOST}:{data}/proxy"
    print(f"open {address}")
    ports = f"-L {page}:{HOST}:{page} -L {data}:{HOST}:{data}"
    print(f"from another machine first: ssh {ports} {platform.node()}", flush=True)
    return ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]


def _free_ports(n: int) -> list[int]:
    """Numbers of ports that nobody listens at now."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(n)]
        for each in sockets:
            each.bind((HOST, 0))
        return [int(each.getsockname()[1]) for each in sockets]


def viewer() -> Path:
    """Rerun's program, which its package puts beside the Python that runs; raises InputError without one."""
    beside = Path(sys.executable).parent
    if (found := shutil.which("rerun", path=str(beside))) is None:
        raise InputError(
            f"{beside}: expected the viewer's program rerun beside Python, found none: pip install rerun-sdk"
        )
    return Path(found)


def names(runs: Sequence[Run]) -> list[str]:
    """A name for each run: what tells it from the others, as `workbench-report` calls it, its seed, how it ended.

    Runs that would have one name get their place in it, too.
    """
    seeds = [run.provenance.get("seed") for run in runs]
    found = []
    for run, name, seed in zip(runs, labels(runs), seeds, strict=True):
        words = [name]
        words += [f"seed={seed}"] * (len(set(seeds)) > 1)
        words += [{"running": "cut off"}.get(run.status, run.status)] * (run.status != "complete")
        found.append(", ".join(words))
    return [f"{name} ({run.path})" if found.count(name) > 1 else name for name, run in zip(found, runs, strict=True)]


def labels(runs: Sequence[Run]) -> list[str]:
    """Say of each run what tells it from the others, but for its seed."""
    settings = [flat(run.settings, str(run.provenance.get("experiment", "custom"))) for run in runs]
    keys = what_varied(settings).keys
    return [label(keys, values) or str(values["experiment"]) for values in settings]


def _readable(places: Sequence[Path]) -> list[Run]:
    """The recordings there, one of each run. Those left out are told; raises InputError when none is left."""
    runs, problems = open_sound_runs(*places)
    left_out = [problem.reason for problem in problems]
    kept: dict[str, Run] = {}
    for run in runs:
        try:
            _ = run.settings  # which name it
        except InputError as error:
            left_out.append(str(error))
            continue
        if run is not (same := kept.setdefault(run.id or str(run.path), run)):
            left_out.append(f"{run.path}: the same run as {same.path}")
    for reason in left_out:
        print(f"workbench-view: left out: {reason}", file=sys.stderr)
    if not kept:
        raise InputError(f"{', '.join(map(str, places))}: expected recordings (.rrd, .rrd.part), found none to open")
    return list(kept.values())


def _beside(runs: Sequence[Run], places: Sequence[Path], folder: Path) -> list[Path]:
    """One recording that holds both, in the order they were given."""
    a, b = sorted(runs, key=lambda run: places.index(run.path))
    first, second = names([a, b])
    path = folder / "beside.rrd"
    write_side_by_side(path, a, b, (first, second))
    print(f"a: {a.path} ({first})\nb: {b.path} ({second})")
    return [path]


def _together(runs: Sequence[Run], folder: Path) -> list[Path]:
    """The recordings as they are and, where there are several, their names in files of their own and their curves."""
    paths = [run.path for run in runs]
    if len(runs) == 1:
        return paths
    found = names(runs)
    overlaid = folder / "overlaid.rrd"
    write_overlaid(overlaid, runs, found, labels(runs))
    print("choose one in the panel on the left (the first of the three buttons at the top right shows it):")
    print("\n".join(f"  {name}" for name in (*found, NAME)))
    return [*paths, *write_names(folder, paths, found), overlaid]  # the viewer shows what it is given last
