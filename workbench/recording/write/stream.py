"""Rerun's streams, each of which it keeps to the end of the process, with two threads, unless it is told otherwise."""

from typing import Any

import rerun as rr
from rerun import bindings  # type: ignore[attr-defined]

_abandoned: list[rr.RecordingStream] = []


def new_stream(application: str, recording: str, **options: Any) -> rr.RecordingStream:
    """Make a stream without the times of logging, and let go of those that nobody holds any more, as `rr.init` does.

    What Rerun makes by itself of a layout stays, with two threads and about 1 MB.
    """
    if not _abandoned:
        bindings.flush_and_cleanup_orphaned_recordings()
    stream = rr.RecordingStream(application, recording_id=recording, **options)
    stream.set_log_time_enabled(False)
    return stream


def abandon(stream: rr.RecordingStream) -> None:
    """Hold a stream whose writer is gone, for which Rerun would wait for ever; no other is let go of from then on."""
    _abandoned.append(stream)
