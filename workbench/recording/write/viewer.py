"""A viewer that shows a run as it goes on: another process reads the file and sends it, so nothing waits for it."""

import os
import select
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr

from workbench.recording.messages import HEAD, end_of_whole

_PERIOD_S = 0.1
_PATIENCE_S = 5.0


class Viewer:
    """Sends the recording `part` to the viewer at `url` as it grows, until it is closed or the viewer does not answer.

    application, recording: what Rerun calls these of the recording. The process ends with this one, however that comes.
    """

    def __init__(self, part: Path, url: str, application: str, recording: str) -> None:
        command = [sys.executable, "-P", "-m", __name__, url, application, recording]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with part.open("rb") as file:  # opened here, as it may have another name by the time that the process begins
            command.append(str(file.fileno()))
            # in a session of its own, as a terminal interrupts all of one
            apart: dict[str, Any] = {"pass_fds": [file.fileno()], "start_new_session": True, **quiet}
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, **apart)

    @property
    def has_left(self) -> bool:
        """Tell whether it has stopped answering."""
        return self._process.poll() is not None

    def close(self) -> bool:
        """Let it have what is left for some seconds; tells whether all has arrived."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            return bool(self._process.wait(2 * _PATIENCE_S) == 0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return False


def main(arguments: Sequence[str]) -> None:
    """The other process, which ends when standard input is closed and all is sent.

    Its code is 1 where the viewer does not answer.
    """
    url, application, recording, file_number = arguments
    stream = rr.RecordingStream(application, recording_id=recording)
    stream.connect_grpc(url)
    with os.fdopen(int(file_number), "rb") as file:
        head, sent, over = file.read(HEAD), HEAD, False
        while not over:
            over = bool(select.select([sys.stdin], [], [], _PERIOD_S)[0])
            end = end_of_whole(file, sent)
            file.seek(sent)
            if end > sent:
                stream.log_file_from_contents("run.rrd", head + file.read(end - sent))
            sent = end
            try:
                stream.flush(timeout_sec=_PATIENCE_S)
            except RuntimeError:
                os._exit(1)  # without waiting for the viewer once more
    stream.disconnect()


if __name__ == "__main__":
    main(sys.argv[1:])
