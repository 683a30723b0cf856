"""Runs as cards in the viewer: opened here, or served for a viewer elsewhere."""

import platform
import sys
from collections.abc import Sequence
from threading import Event
from urllib.parse import urlsplit

from workbench.cli.view import viewer
from workbench.recording.write.file import HOST
from workbench.results.entry import Entry
from workbench.results.gallery import Gallery, gallery
from workbench.results.report.tables import printable
from workbench.utils.processes import run


def show(found: Sequence[Entry], serve: bool) -> int:
    """Serve the runs until the viewer is closed or, where none is to be opened, until the command is interrupted.

    Returns 0, 1 when the viewer failed. Raises InputError as `gallery` does, and without a viewer that is to be opened.
    """
    program = None if serve else viewer()
    try:
        with gallery(found) as served:
            for sentence in served.left_out:
                print(f"workbench-runs: {printable(sentence)}", file=sys.stderr)
            print(f"{served.n_runs} runs as cards at {served.url}", flush=True)
            if program is None:
                print(_ways_to(served), flush=True)
                wait()
            code = run([str(program), "--bind", HOST, "--port", "auto", served.url]).returncode
    except KeyboardInterrupt:
        return 0 if serve else 130
    if code:
        advice = "where there is no display, --serve says how to look from elsewhere"
        print(f"workbench-runs: the viewer ended with exit code {code}; {advice}", file=sys.stderr)
    return 1 if code else 0


def wait() -> None:
    """Wait until the command is interrupted."""
    Event().wait()


def _ways_to(served: Gallery) -> str:
    """Say what opens a gallery, here and on another machine, to which nothing but a tunnel leads."""
    port = urlsplit(served.url).port
    command = f"rerun --bind {HOST} '{served.url}'"
    return (
        f"on this machine: {command}\n"
        f"elsewhere: ssh -N -L {port}:{HOST}:{port} {platform.node()}, and beside it the same {command}\n"
        "until this is interrupted (Ctrl-C)"
    )
