"""Streaming of a run to a viewer: a separate process sends the recording's file as it grows.

A second sink of Rerun's stream would be simpler, but a viewer that stops answering would block the file, too, and
prevent the run from ending (rerun-sdk 0.41).
"""

import os
import select
import subprocess
import sys
from pathlib import Path

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
    part : the recording's file.
    url : of the viewer.
    application, recording : Rerun's ids of the recording.
    """
    with part.open("rb") as file:  # opened here, since it may be renamed before the process starts
        command = module(__name__, url, application, recording, str(file.fileno()))
        return start(command, pass_fds=[file.fileno()])


def _send(url: str, application: str, recording: str, descriptor: str) -> None:
    stream = rr.RecordingStream(application, recording_id=recording)
    stream.connect_grpc(url)
    with os.fdopen(int(descriptor), "rb") as file:
        head, sent, over = file.read(HEAD), HEAD, False
        while not over:
            over = bool(select.select([sys.stdin], [], [], _PERIOD_S)[0])
            whole = end_of_whole(file, sent)
            file.seek(sent)
            if whole > sent:
                stream.log_file_from_contents("run.rrd", head + file.read(whole - sent))
            sent = whole
            try:
                stream.flush(timeout_sec=PATIENCE_S)
            except RuntimeError:
                os._exit(1)  # disconnecting would wait for the viewer once more
    stream.disconnect()


if __name__ == "__main__":
    _send(*sys.argv[1:])
