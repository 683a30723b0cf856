"""Names for recordings in the viewer, without touching the recordings."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning


def write_names(folder: Path, recordings: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Write an .rrd for each recording that holds nothing but its name; returns their paths.

    Opened together with the recording it becomes part of it, since both have one recording id.
    """
    written = []
    for k, (recording, name) in enumerate(zip(recordings, names, strict=True)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # a recording cut off has no footer
            store = RrdReader(recording).recordings()[0]
        stream = rr.RecordingStream(store.application_id, recording_id=store.recording_id, send_properties=False)
        stream.set_log_time_enabled(False)
        stream.set_sinks(rr.FileSink(folder / f"name_{k:03d}.rrd"))
        stream.send_recording_name(name)
        stream.flush()
        stream.disconnect()
        written.append(folder / f"name_{k:03d}.rrd")
    return written
