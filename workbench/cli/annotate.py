"""`workbench annotate`: annotate joints in a video by hand, on a local web page."""

import platform
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from workbench.detections.annotation.annotations import Annotations
from workbench.detections.annotation.frames import Frames
from workbench.detections.annotation.server import HOST, Server
from workbench.utils.input_path import expanded


def annotate(
    video: Annotated[Path, typer.Argument(metavar="VIDEO", help="A video, or a folder of images.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.csv", help="The file of annotations.")],
    port: Annotated[int, typer.Option(help="Port of 127.0.0.1; 0: any free port.")] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address.")] = False,
) -> None:
    """Annotate joints in a video by hand, on a local web page.

    The file is saved after every annotation; an existing file is extended.
    It is an input of dataset.keypoints, dataset.initial_annotations,
    dataset.eval_annotations and `workbench calibrate height`.

    Examples:
      workbench annotate walk.mp4 -o annotations.csv
      workbench annotate frames/ -o annotations.csv --port 8000 --no-browser
    """
    frames = Frames(expanded(video))
    annotations = Annotations(output, frames.n_frames, frames.size)
    with Server(frames, annotations, port) as server:
        print(
            f"{_counts(annotations)}\n"
            f"on this machine: {server.url}\n"
            f"from another machine: ssh -N -L {server.server_port}:{HOST}:{server.server_port} {platform.node()}, "
            "then open the same address\n"
            "Ctrl-C ends the command; every annotation is saved immediately",
            flush=True,
        )
        if not no_browser:
            webbrowser.open(server.url)
        serve(server)
    print(f"\n{_counts(annotations)}")


def serve(server: Server) -> None:
    """Serve until the command is interrupted."""
    with suppress(KeyboardInterrupt):
        server.serve_forever()


def _counts(annotations: Annotations) -> str:
    n_annotated = len(annotations.by_frame())
    return f"{annotations.path}: {len(annotations.values)} joints in {n_annotated} of {annotations.n_frames} frames"
