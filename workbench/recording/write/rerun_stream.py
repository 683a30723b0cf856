"""Rerun's streams: made without wall-clock times, freed in a long process, and given up where the disk is full.

How Rerun frees its streams is not documented; this was tested with rerun-sdk 0.41.
"""

from threading import Event, Thread
from typing import Any

import rerun as rr

_given_up: list[rr.RecordingStream] = []


def new_stream(application: str, recording: str, **options: Any) -> rr.RecordingStream:
    """Return a new stream without the times of logging, and free the streams that nothing refers to any more.

    `rr.init` frees them; otherwise each keeps two threads and about 1 MB until the process ends. It waits for the
    writers of all streams, so that nothing is freed once one was given up.
    """
    if not _given_up:
        rr.init("workbench", init_logging=False)
    stream = rr.RecordingStream(application, recording_id=recording, **options)
    stream.set_log_time_enabled(False)
    return stream


def give_up(stream: rr.RecordingStream) -> None:
    """Keep Rerun from waiting for a stream's writer that has failed, now or as the process ends.

    Rerun waits when the stream is deleted, which a thread that never ends prevents, and in its handler at exit.
    """
    _given_up.append(stream)
    Thread(target=lambda _: Event().wait(), args=(stream,), daemon=True, name="holds a stream given up").start()
    rr.unregister_shutdown()
