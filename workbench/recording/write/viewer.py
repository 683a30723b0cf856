"""Show a run in a viewer while it runs.

A process of its own sends the recording's file as it grows. A second sink of Rerun's stream would be simpler, but a
viewer that stops answering would stop the file, too, and keep the run from ending (rerun-sdk 0.41).
"""

import os
import select
import sys
from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from workbench.recording.messages import HEAD, end_of_whole
from workbench.utils.processes import end, module, start

_PERIOD_S = 0.1
_PATIENCE_S = 5.0


class Viewer:
    """Sends the recording `part` to the viewer at `url` as it grows, until it is closed or the viewer does not answer.

    application, recording: the ids that Rerun gives to the recording.
    """

    def __init__(self, part: Path, url: str, application: str, recording: str) -> None:
        with part.open("rb") as file:  # opened here, as it may have another name by the time that the process begins
            command = module(__name__, url, application, recording, str(file.fileno()))
            self._process = start(command, background=True, pass_fds=[file.fileno()])

    @property
    def has_left(self) -> bool:
        """Whether the viewer has stopped answering."""
        return self._process.poll() is not None

    def close(self) -> bool:
        """Wait some seconds until the rest is sent; return whether all has arrived."""
        return end(self._process, 2 * _PATIENCE_S) == 0


def main(arguments: Sequence[str]) -> None:
    """Send the file until standard input is closed, as it is when the parent ends; exit code 1: no answer."""
    url, application, recording, descriptor = arguments
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
                stream.flush(timeout_sec=_PATIENCE_S)
            except RuntimeError:
                os._exit(1)  # disconnecting would wait for the viewer once more
    stream.disconnect()


if __name__ == "__main__":
    main(sys.argv[1:])
