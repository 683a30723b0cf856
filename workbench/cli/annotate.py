"""workbench-mark: annotate joints in a video by hand, on a page that only this machine can open.

The file is written after every annotation; an existing file is continued. It is an input of dataset.keypoints,
dataset.start_marks, dataset.eval_marks and workbench-calibrate height.
"""

import argparse
import platform
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from workbench.annotation.annotations import Annotations
from workbench.annotation.frames import Frames
from workbench.annotation.server import HOST, Server
from workbench.utils.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until it is interrupted. Return 0, or 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="workbench-mark", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("video", metavar="VIDEO", type=Path, help="a video, or a folder of images")
    parser.add_argument("-o", "--output", metavar="MARKS.csv", type=Path, required=True, help="the file of annotations")
    parser.add_argument("--port", type=int, default=0, help="port of 127.0.0.1; by default a free one")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    arguments = parser.parse_args(argv)
    try:
        frames = Frames(arguments.video.expanduser())
        annotations = Annotations(arguments.output, frames.n_frames, frames.size)
        with Server(frames, annotations, arguments.port) as server:
            print(_address(server), flush=True)
            if not arguments.no_browser:
                webbrowser.open(server.url)
            serve(server)
    except InputError as error:
        print(f"workbench-mark: {error}", file=sys.stderr)
        return 2
    print(_counts(annotations))
    return 0


def serve(server: Server) -> None:
    """Serve until the command is interrupted."""
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print()


def _address(server: Server) -> str:
    """Describe the annotations so far, and how to open the page from this and from another machine."""
    port = server.server_port
    return (
        f"{_counts(server.annotations)}\n"
        f"on this machine: {server.url}\n"
        f"from another one: ssh -N -L {port}:{HOST}:{port} {platform.node()}, and then the same address\n"
        "stop with Ctrl-C; every annotation is written at once"
    )


def _counts(annotations: Annotations) -> str:
    n_annotated = len(annotations.by_frame())
    return f"{annotations.path}: {len(annotations.values)} joints in {n_annotated} of {annotations.n_frames} frames"
