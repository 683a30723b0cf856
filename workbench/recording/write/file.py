"""The Rerun file of a run, published when the run ends regularly.

Streams have no wall-clock times and are abandoned when the disk is full. The release of Rerun's streams is not
documented; it was tested with rerun-sdk 0.41.
"""

import errno
import logging
import mmap
import os
import re
import shutil
import socket
import subprocess
import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import Any, Self

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from workbench.recording.format import FORMAT
from workbench.recording.settings import choices_of, numbers_and_texts
from workbench.recording.write import viewer
from workbench.recording.write.columns import Columns, Entities
from workbench.utils.environment import environment
from workbench.utils.errors import InputError
from workbench.utils.process_limits import largest_file
from workbench.utils.processes import end
from workbench.utils.signals import deferred

logger = logging.getLogger(__name__)

SETTINGS, CHOICES = "settings", "choices"
"""Properties with the configuration key by key: numbers as float64, and everything else as text."""
HOST, PORT = "127.0.0.1", 9876
"""Default address of `rerun`."""
_MIN_FREE_BYTES, _MAX_FREE_BYTES = 2_000_000, 100_000_000
"""Bounds of the free space that is required for writing between two flushes and closing the file."""
_MAX_WRITE_S = 120.0
_FLUSH_TIMEOUT_S = 1.0
_KEEPS_OPEN_NAMES = os.name == "nt"
"""Whether the system renames no open files."""
_abandoned: list[rr.RecordingStream] = []


class RecordingFile:
    """A Rerun stream into `path`, an .rrd, with the properties of every recording.

    It is a context manager. While it is open the file is named `<path>.part` and is readable up to the last flush, even
    when the process is killed. On a regular exit it is renamed to `path`; on an exception the .part is completed and
    stays. The property `run` has the status: running, failed, interrupted, complete, or the value of `status`. Older
    files of these names are replaced.

    Parameters
    ----------
    run_id : unique per run.
    config_yaml : the resolved configuration.
    provenance : the run's origin (seed, versions).
    settings : the nested configuration, to be recorded key by key.
    stream : also send everything to a viewer that listens at HOST:PORT. The attribute `is_streaming` becomes False when
        none does, or as soon as it does not answer; the run never waits for it.
    """

    def __init__(
        self, path: str | Path, *, run_id: str, config_yaml: str, provenance: Mapping[str, Any],
        settings: Mapping[str, Any] | None = None, stream: bool = False,
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.is_streaming, self.status = stream, "complete"
        self.warnings: list[str] = []  # to be recorded
        self._sender: subprocess.Popen[bytes] | None = None
        self._run_id, self._config_yaml, self._provenance = run_id, config_yaml, provenance
        self._settings = settings or {}
        # Recordings of one application share their layout in the viewer; Rerun warns of other characters.
        self._application = re.sub(r"[^A-Za-z0-9_-]", "-", run_id)
        # Without a batcher a chunk ends at a flush, which the recorder decides.
        self.stream = new_stream(self._application, run_id, batcher_config=rr.ChunkBatcherConfig.NEVER())

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            opened.callback(rr.set_strict_mode, rr.strict_mode())
            rr.set_strict_mode(True)  # Rerun raises errors instead of logging them
            self._open()
            self._at_exit = opened.pop_all()
        return self

    def _open(self) -> None:
        self.part.parent.mkdir(parents=True, exist_ok=True)
        begun = self.part if _KEEPS_OPEN_NAMES else self.part.with_name(f"{self.part.name}.begun")
        if self.part.is_dir():
            raise InputError(f"{self.part}: cannot be written: it is a folder")
        try:
            self.stream.set_sinks(rr.FileSink(begun))
        except RuntimeError as error:
            raise InputError(f"{self.part}: cannot be written: {error}") from None
        self.send_property("run", {"id": self._run_id, "status": "running", "format": FORMAT})
        self.send_property("environment", environment())
        self.send_property("provenance", self._provenance)
        self.stream.send_property("config", rr.TextDocument(self._config_yaml, media_type="text/plain"))
        numbers, texts = numbers_and_texts(self._settings, choices_of(self._provenance.get("choices", ())))
        self.send_property(SETTINGS, numbers)
        self.send_property(CHOICES, texts)
        self.flush()
        os.replace(begun, self.part)  # which has its properties from the beginning
        if self.is_streaming and viewer_listens():
            url = f"rerun+http://{HOST}:{PORT}/proxy"
            self._sender = viewer.start_sender(self.part, url, self._application, self._run_id)
        elif self.is_streaming:
            self._leave_viewer(f"no viewer listens at {HOST}:{PORT}")

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        ended = "failed" if kind is None or not issubclass(kind, KeyboardInterrupt) else "interrupted"
        try:
            if kind is None:
                self._publish()
            else:
                self._close(ended)
        except KeyboardInterrupt:
            if self.part.exists():
                self._close("interrupted")
            raise
        finally:
            self._at_exit.close()
            if kind is not None or self.part.exists():
                logger.warning("the run ended early; its recording up to there is in %s", self.part)
            if self._sender is not None and end(self._sender, 2 * viewer.PATIENCE_S) and self.is_streaming:
                logger.warning(f"the viewer at {HOST}:{PORT} does not answer: it may not have received all data")

    def _publish(self) -> None:
        """Rename the file to its final name, consistent with its status whenever a signal arrives."""
        self.flush()  # may take long
        with deferred():
            self._close(self.status)
            with warnings.catch_warnings():  # raises without a footer: the last bytes did not reach the disk
                warnings.simplefilter("error", RerunWarning)
                RrdReader(self.part)
            os.replace(self.part, self.path)

    def _close(self, status: str) -> None:
        self.send_property("run", {"status": status})
        self.flush()
        self.stream.disconnect()  # not after a failed flush: it would wait for the failed writer

    def send(self, entities: Entities, static: bool = False) -> None:
        """Log pairs (entity path, archetype)."""
        for path, archetype in entities:
            self.stream.log(path, archetype, static=static)

    def write(self, columns: Columns, min_bytes: int = 0) -> None:
        """Send the rows of `columns`, see `Columns.write`.

        Interruptions are deferred meanwhile, so that frames are complete in the file and no row is sent twice.
        """
        with deferred():
            columns.write(self.stream, min_bytes)

    def send_numbers(self, name: str, numbers: Mapping[str, float]) -> None:
        """Set a property's keys to numbers, as float64, so that many recordings fit into one table."""
        self.send_property(name, {key: float(value) for key, value in numbers.items()})

    def send_property(self, name: str, values: Mapping[str, Any]) -> None:
        """Set keys of a property; its other keys stay."""
        if values:
            self.stream.send_property(name, arrow(values))

    def warn(self, message: str) -> None:
        """Log a message, and append it to `warnings` to be recorded."""
        logger.warning(message)
        self.warnings.append(message)

    def check_space(self) -> None:
        """Raise OSError where less space is free than the file takes, within bounds.

        Rerun's writer does not recover from a full disk, so the run ends while the file can still be closed.
        """
        if (free := self._free_bytes()) < min(max(self.part.stat().st_size, _MIN_FREE_BYTES), _MAX_FREE_BYTES):
            message = f"only {free / 1e6:.1f} MB are left for it on the disk, the recording ends here"
            raise OSError(errno.ENOSPC, message, str(self.part))

    def flush(self) -> None:
        """Write all logged data to the disk; raises OSError on failure."""
        if self.is_streaming and self._sender is not None and self._sender.poll() is not None:
            self._leave_viewer(f"the viewer at {HOST}:{PORT} does not answer")
        began = monotonic()
        while True:
            try:
                return self.stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            except RuntimeError as error:
                full = self._free_bytes() < mmap.PAGESIZE
                if full or monotonic() - began > _MAX_WRITE_S:
                    abandon(self.stream)
                    message = "no space is left for it on the disk" if full else f"writing failed, {error}"
                    raise OSError(errno.ENOSPC if full else errno.EIO, message, str(self.part)) from None

    def _free_bytes(self) -> int:
        """Return the number of bytes that the file may grow by."""
        free, limit = shutil.disk_usage(self.part.parent).free, largest_file()
        return free if limit is None else min(free, limit - self.part.stat().st_size)

    def _leave_viewer(self, reason: str) -> None:
        self.is_streaming = False
        self.warn(f"{reason}: recording to the file only")


def new_stream(application: str, recording: str, **options: Any) -> rr.RecordingStream:
    """Return a new stream without logging times, and free the streams without references.

    `rr.init` frees them; otherwise each holds two threads and about 1 MB until the process ends. Since it waits for the
    writers of all streams, nothing is freed after one was abandoned.
    """
    if not _abandoned:
        rr.init("workbench", init_logging=False)
    with deferred():  # else the finalizer of a half-made stream prints a traceback
        stream = rr.RecordingStream(application, recording_id=recording, **options)
    stream.set_log_time_enabled(False)
    return stream


@contextmanager
def written_file(path: Path, application: str, recording: str, layout: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Yield a stream that is written to an .rrd with a layout."""
    stream = new_stream(application, recording)
    stream.set_sinks(rr.FileSink(path), default_blueprint=layout)
    yield stream
    stream.flush()
    stream.disconnect()


def abandon(stream: rr.RecordingStream) -> None:
    """Prevent Rerun from waiting for a stream's failed writer, now or at the end of the process.

    Rerun waits when the stream is deleted, which an endless thread prevents, and in its handler at exit.
    """
    _abandoned.append(stream)
    Thread(target=lambda _: Event().wait(), args=(stream,), daemon=True, name="holds an abandoned stream").start()
    rr.unregister_shutdown()


def viewer_listens() -> bool:
    """Return whether a process accepts connections at HOST:PORT; without one, sending blocks for seconds."""
    try:
        socket.create_connection((HOST, PORT), timeout=0.5).close()
    except OSError:
        return False
    return True


def arrow(values: Mapping[str, Any]) -> rr.AnyValues:
    """Return components of strings, numbers and lists or arrays of them, none empty; float64 stays float64.

    The values are Arrow arrays, since AnyValues would require the first run's types of every later run in the process.
    """
    columns = {key: pa.array(np.atleast_1d(np.asarray(value)).tolist()) for key, value in values.items()}
    return rr.AnyValues(**columns)
