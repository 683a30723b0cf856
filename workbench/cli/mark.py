"""workbench-mark: mark joints in a video by hand, on a page that only this machine can open.

The file is written after every mark, and gone on with when it is there. It is what dataset.keypoints,
dataset.start_marks and dataset.eval_marks take, and workbench-calibrate height.
"""

import argparse
import platform
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.marking.frames import Frames
from workbench.marking.server import HOST, Server
from workbench.marking.table import Table, open_table


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until it is interrupted. Returns 0, or 2 for what cannot be read or written."""
    parser = argparse.ArgumentParser(
        prog="workbench-mark", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("video", metavar="VIDEO", type=Path, help="a video, or a folder of images")
    parser.add_argument("-o", "--output", metavar="MARKS.csv", type=Path, required=True, help="the file of marks")
    parser.add_argument("--port", type=int, default=0, help="of 127.0.0.1; by default a free one")
    parser.add_argument("--no-browser", action="store_true", help="only say the address")
    arguments = parser.parse_args(argv)
    try:
        frames = Frames(arguments.video.expanduser())
        table = open_table(arguments.output, frames.n_frames, frames.size)
        with Server(frames, table, arguments.port) as server:
            print(_where(server, table), flush=True)
            if not arguments.no_browser:
                webbrowser.open(server.url)
            serve(server)
    except InputError as error:
        print(f"workbench-mark: {error}", file=sys.stderr)
        return 2
    print(f"{table.path}: {_counted(table)}")
    return 0


def serve(server: Server) -> None:
    """Serve until the command is interrupted."""
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print()


def _where(server: Server, table: Table) -> str:
    """Say what there is already, and how the page is opened, here and from another machine."""
    port = server.server_port
    return (
        f"{table.path}: {_counted(table)}\n"
        f"on this machine: {server.url}\n"
        f"elsewhere: ssh -N -L {port}:{HOST}:{port} {platform.node()}, and then the same address\n"
        "until this is interrupted (Ctrl-C); every mark is written at once"
    )


def _counted(table: Table) -> str:
    return f"{len(table.marks)} marks in {len(table.by_frame())} of {table.n_frames} frames"
