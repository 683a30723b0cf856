"""Streaming of a run to a viewer: a separate process sends the recording's file as it grows.

A second sink of Rerun's stream would be simpler, but a viewer that stops answering would block the file, too, and
prevent the run from ending (rerun-sdk 0.41).
"""

import os
import subprocess
import sys
from pathlib import Path
from threading import Event, Thread
from typing import BinaryIO

import rerun as rr

from workbench.recording.read.chunks import HEAD, end_of_whole
from workbench.utils.processes import module, start

PATIENCE_S = 5.0
_PERIOD_S = 0.1


def start_sender(part: Path, url: str, application: str, recording: str) -> subprocess.Popen[bytes]:
    """Start the process that sends a recording to a viewer until its standard input is closed.

    It ends earlier if the viewer does not answer.

    Parameters
    ----------
    part : the recording's file, which is renamed when the run ends.
    url : of the viewer.
    application, recording : Rerun's ids of the recording.
    """
    return start(module(__name__, url, application, recording, str(part)))


def _send(url: str, application: str, recording: str, part: str) -> None:
    stream, closed = rr.RecordingStream(application, recording_id=recording), Event()
    stream.connect_grpc(url)
    Thread(target=_wait_for_end, args=(closed,), daemon=True).start()
    with _opened(Path(part)) as file:
        head, sent, over = file.read(HEAD), HEAD, False
    while not over:
        over = closed.wait(_PERIOD_S)
        with _opened(Path(part)) as file:  # only briefly: Windows renames no open file
            whole = end_of_whole(file, sent)
            file.seek(sent)
            added = file.read(whole - sent)
        if added:
            stream.log_file_from_contents("run.rrd", head + added)
        sent = whole
        try:
            stream.flush(timeout_sec=PATIENCE_S)
        except RuntimeError:
            os._exit(1)  # disconnecting would wait for the viewer once more
    stream.disconnect()


def _wait_for_end(closed: Event) -> None:
    sys.stdin.read()
    closed.set()


def _opened(part: Path) -> BinaryIO:
    """Open the recording's file, also after it was renamed."""
    try:
        return part.open("rb")
    except FileNotFoundError:
        return part.with_suffix("").open("rb")


if __name__ == "__main__":
    _send(*sys.argv[1:])
