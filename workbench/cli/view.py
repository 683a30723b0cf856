"""`workbench view`: open one recording in the Rerun viewer, or two side by side."""

import os
import platform
import shutil
import socket
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from typer import Argument, Exit, Option

from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.recording.side_by_side import write_side_by_side
from workbench.recording.write.file import HOST
from workbench.results.report.variation import flat, label, what_varied
from workbench.utils import processes
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible


@interruptible()
def view(
    recordings: Annotated[list[Path], Argument(metavar="RUN|FOLDER [RUN|FOLDER]", help="One or two recordings.")],
    web: Annotated[bool, Option("--web", help="Serve a viewer for a browser and print its address.")] = False,
) -> None:
    """Open a recording in the viewer, or two side by side, labelled by their differences.

    Examples:
      workbench view a.rrd b.rrd
      workbench view recordings/sweeps/priors/3 --web
    """
    program, runs = viewer(), _readable(recordings)
    with TemporaryDirectory(prefix="workbench-") as folder:  # exists until the viewer is closed
        path = runs[0].path if len(runs) == 1 else _side_by_side(runs, recordings, Path(folder))
        code = processes.run([str(program), "--bind", HOST, *_ports(web), str(path)]).returncode
    if code:
        has_display = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        hint = "" if has_display else "; there is no display: --web serves a viewer for a browser"
        print(f"workbench view: the viewer ended with exit code {code}{hint}", file=sys.stderr)
        raise Exit(1)


def _ports(web: bool) -> list[str]:
    """Return the viewer's options for its ports; for a browser, print its local and remote addresses."""
    if not web:
        return ["--port", "auto"]
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server((HOST, 0))) for _ in range(2)]
        page, data = (server.getsockname()[1] for server in sockets)  # free ports
    print(f"open http://{HOST}:{page}/?url=rerun%2Bhttp://{HOST}:{data}/proxy")
    ports = f"-L {page}:{HOST}:{page} -L {data}:{HOST}:{data}"
    print(f"from another machine first: ssh {ports} {platform.node()}", flush=True)
    return ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]


def viewer() -> Path:
    """Return the path of Rerun's viewer, installed next to Python; InputError if it is missing."""
    folder = Path(sys.executable).parent
    if (path := shutil.which("rerun", path=str(folder))) is None:
        raise InputError(f"{folder}: expected the viewer `rerun` in this folder; run pip install rerun-sdk")
    return Path(path)


def names(runs: Sequence[Run]) -> list[str]:
    """Return a unique name for each run: its differences from the others, seed, status, and its path if needed."""
    settings = [flat(run.settings, str(run.provenance.get("experiment", "custom"))) for run in runs]
    keys = what_varied(settings).keys
    several_seeds = len({run.provenance.get("seed") for run in runs}) > 1
    run_names = []
    for run, values in zip(runs, settings, strict=True):
        name = label(keys, values) or str(values["experiment"])
        seed = [f"seed={run.provenance.get('seed')}"] if several_seeds else []
        status = [{"running": "unfinished"}.get(run.status, run.status)] if run.status != "complete" else []
        run_names.append(", ".join([name, *seed, *status]))
    return [
        f"{name} ({run.path})" if run_names.count(name) > 1 else name for name, run in zip(run_names, runs, strict=True)
    ]


def _readable(places: Sequence[Path]) -> list[Run]:
    """Return one or two readable recordings of different runs, and print the omitted ones.

    Raises InputError where none or more than two remain.
    """
    runs, problems = open_sound_runs(*places)
    omitted = [problem.reason for problem in problems]
    by_id: dict[str, Run] = {}
    for run in runs:
        try:
            _ = run.settings  # needed for its name
        except InputError as error:
            omitted.append(str(error))
            continue
        if run is not (same := by_id.setdefault(run.id or str(run.path), run)):
            omitted.append(f"{run.path}: the same run as {same.path}")
    for reason in omitted:
        print(f"workbench view: omitted: {reason}", file=sys.stderr)
    listed, n = ", ".join(map(str, places)), len(by_id)
    if not n:
        raise InputError(f"{listed}: expected recordings (.rrd, .rrd.part), found none that can be opened")
    if n > 2:
        raise InputError(f"{listed}: expected one or two recordings, found {n}; workbench report compares many")
    return list(by_id.values())


def _side_by_side(runs: Sequence[Run], places: Sequence[Path], folder: Path) -> Path:
    """Write one recording with both runs, in the order of the arguments, and return its path."""
    a, b = sorted(runs, key=lambda run: [place in (run.path, *run.path.parents) for place in places].index(True))
    first, second = names([a, b])
    path = folder / "side_by_side.rrd"
    write_side_by_side(path, a, b, (first, second))
    print(f"a: {a.path} ({first})\nb: {b.path} ({second})")
    return path
