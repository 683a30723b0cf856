"""`workbench view`: recordings in the Rerun viewer; two are shown side by side, more with their curves overlaid."""

import platform
import shutil
import socket
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from typer import Argument, Exit, Option

from workbench.recording.read.chunks import HEAD, end_of_whole
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.recording.side_by_side import OVERLAID, write_names, write_overlaid, write_side_by_side
from workbench.recording.write.file import HOST
from workbench.results.report.variation import flat, label, what_varied
from workbench.utils import processes
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible


@interruptible()
def view(
    recordings: Annotated[list[Path], Argument(metavar="RUN|FOLDER...", help="Recordings, or folders of them.")],
    web: Annotated[bool, Option("--web", help="For a browser, on a server too: prints what to open.")] = False,
) -> None:
    """Open recordings in the viewer: two side by side, more under what varied with their curves over each other.

    Examples:

    workbench view a.rrd b.rrd

    workbench view recordings/sweeps/priors --web
    """
    program, runs = viewer(), _readable(recordings)
    pair = len(recordings) == len(runs) == 2 and all(path.is_file() for path in recordings)
    with TemporaryDirectory(prefix="workbench-") as folder:  # kept as long as the viewer is open
        files = _side_by_side(runs, recordings, Path(folder)) if pair else _together(runs, Path(folder))
        code = show([str(program), "--bind", HOST, *_ports(web)], files)
    if code:
        print(f"workbench view: the viewer ended with exit code {code}", file=sys.stderr)
        raise Exit(1)


def show(command: Sequence[str], files: Sequence[Path]) -> int:
    """Open recordings in the viewer, which shows the last of them, and wait until it is closed; returns its exit code.

    Several go through a pipe one after the other: it reads files at once, and shows the one that it has read last.
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
    """Return the viewer's options for its ports; in a browser, print what opens it from here and from elsewhere."""
    if not web:
        return ["--port", "auto"]
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server((HOST, 0))) for _ in range(2)]
        page, data = (each.getsockname()[1] for each in sockets)  # which are free now
    print(f"open http://{HOST}:{page}/?url=rerun%2Bhttp://{HOST}:{data}/proxy")
    ports = f"-L {page}:{HOST}:{page} -L {data}:{HOST}:{data}"
    print(f"from another machine first: ssh {ports} {platform.node()}", flush=True)
    return ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]


def viewer() -> Path:
    """Return Rerun's program, which its package installs next to Python; raises InputError without one."""
    folder = Path(sys.executable).parent
    if (path := shutil.which("rerun", path=str(folder))) is None:
        raise InputError(f"{folder}: expected the viewer's program rerun next to Python; pip install rerun-sdk")
    return Path(path)


def names(runs: Sequence[Run]) -> list[str]:
    """Return a name for each run: what distinguishes it from the others, its seed, how it ended, and its path where
    another has the same name."""
    several_seeds = len({run.provenance.get("seed") for run in runs}) > 1
    named = []
    for run, name in zip(runs, labels(runs), strict=True):
        seed = [f"seed={run.provenance.get('seed')}"] if several_seeds else []
        status = [{"running": "cut off"}.get(run.status, run.status)] if run.status != "complete" else []
        named.append(", ".join([name, *seed, *status]))
    return [f"{name} ({run.path})" if named.count(name) > 1 else name for name, run in zip(named, runs, strict=True)]


def labels(runs: Sequence[Run]) -> list[str]:
    """Return what distinguishes each run from the others, but for its seed."""
    settings = [flat(run.settings, str(run.provenance.get("experiment", "custom"))) for run in runs]
    keys = what_varied(settings).keys
    return [label(keys, values) or str(values["experiment"]) for values in settings]


def _readable(places: Sequence[Path]) -> list[Run]:
    """Return the recordings there, one of each run, and print which are left out; InputError when none is left."""
    runs, problems = open_sound_runs(*places)
    left_out = [problem.reason for problem in problems]
    by_id: dict[str, Run] = {}
    for run in runs:
        try:
            _ = run.settings  # which name it
        except InputError as error:
            left_out.append(str(error))
            continue
        if run is not (same := by_id.setdefault(run.id or str(run.path), run)):
            left_out.append(f"{run.path}: the same run as {same.path}")
    for reason in left_out:
        print(f"workbench view: left out: {reason}", file=sys.stderr)
    if not by_id:
        raise InputError(f"{', '.join(map(str, places))}: expected recordings (.rrd, .rrd.part), found none to open")
    return list(by_id.values())


def _side_by_side(runs: Sequence[Run], places: Sequence[Path], folder: Path) -> list[Path]:
    """Write one recording that holds both, in the order they were given."""
    a, b = sorted(runs, key=lambda run: places.index(run.path))
    first, second = names([a, b])
    path = folder / "side_by_side.rrd"
    write_side_by_side(path, a, b, (first, second))
    print(f"a: {a.path} ({first})\nb: {b.path} ({second})")
    return [path]


def _together(runs: Sequence[Run], folder: Path) -> list[Path]:
    """Return the recordings and, where there are several, files with their names and one with all their curves."""
    paths = [run.path for run in runs]
    if len(runs) == 1:
        return paths
    named = names(runs)
    write_overlaid(folder / "overlaid.rrd", runs, named, labels(runs))
    print("choose one in the panel on the left (the first of the three buttons at the top right shows it):")
    print("\n".join(f"  {name}" for name in (*named, OVERLAID)))
    return [*paths, *write_names(folder, paths, named), folder / "overlaid.rrd"]  # the viewer shows the last file
