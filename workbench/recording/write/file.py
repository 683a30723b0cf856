"""One Rerun file per run, published only when the run ends well.

Streams are made without wall-clock times and given up where the disk is full. How Rerun frees its streams is not
documented; this was tested with rerun-sdk 0.41.
"""

import errno
import logging
import os
import re
import resource
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

from workbench.recording.migrations import FORMAT
from workbench.recording.settings import choices_of, numbers_and_texts
from workbench.recording.write import viewer
from workbench.recording.write.columns import Columns, Entities
from workbench.utils.environment import environment
from workbench.utils.errors import InputError
from workbench.utils.processes import end
from workbench.utils.signals import deferred

logger = logging.getLogger(__name__)

SETTINGS, CHOICES = "settings", "choices"
"""Properties with the configuration key by key: its numbers, float64, and all else, as text."""
HOST, PORT = "127.0.0.1", 9876
"""Where `rerun` listens by default."""
_LEAST_BYTES, _MOST_BYTES = 2_000_000, 100_000_000  # to write between two flushes, and to close the file
_LONGEST_WRITE_S = 120.0
_FLUSH_TIMEOUT_S = 1.0
_given_up: list[rr.RecordingStream] = []


class RecordingFile:
    """Rerun's stream into `path`, an .rrd, with the properties that every recording of ours has.

    A context manager. While it is open the file is called `<path>.part` and is readable up to the last flush, even
    when the process is killed. On a clean exit it becomes `path`; on an exception the .part is completed and kept,
    and nothing is published. The property `run` says which of these happened (status: running, failed, interrupted,
    complete, or what `status` was set to). Older files of these names are replaced.

    Parameters
    ----------
    run_id : unique per run.
    config_yaml : the resolved configuration.
    provenance : where the run came from (seed, versions).
    settings : the configuration again, nested, to be recorded key by key.
    stream : also send everything to a viewer that listens at HOST:PORT. The attribute `is_streaming` becomes False when
    none does, or as
        soon as it does not answer; the run never waits for it.
    """

    def __init__(
        self, path: str | Path, *, run_id: str, config_yaml: str, provenance: Mapping[str, Any],
        settings: Mapping[str, Any] | None = None, stream: bool = False,
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.is_streaming, self.status = stream, "complete"
        self.warnings: list[str] = []  # that wait to be recorded
        self._sender: subprocess.Popen[bytes] | None = None
        self._run_id, self._config_yaml, self._provenance = run_id, config_yaml, provenance
        self._settings = settings or {}
        # Recordings of one application would share their layout in the viewer; in other letters Rerun warns.
        self._application = re.sub(r"[^A-Za-z0-9_-]", "-", run_id)
        # Without a batcher a chunk ends where we flush, so that equal runs give equal chunks.
        self.stream = new_stream(self._application, run_id, batcher_config=rr.ChunkBatcherConfig.NEVER())

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            opened.callback(rr.set_strict_mode, rr.strict_mode())
            rr.set_strict_mode(True)  # Rerun raises where it would only log
            self._open()
            self._at_exit = opened.pop_all()
        return self

    def _open(self) -> None:
        self.part.parent.mkdir(parents=True, exist_ok=True)
        try:
            self.stream.set_sinks(rr.FileSink(self.part))
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
                logger.warning("the run ended early; what was recorded until then is in %s", self.part)
            if self._sender is not None and end(self._sender, 2 * viewer.PATIENCE_S) and self.is_streaming:
                logger.warning(f"the viewer at {HOST}:{PORT} does not answer: not all has arrived there")

    def _publish(self) -> None:
        """Give the file its name. The status in it agrees with that, whenever a signal arrives."""
        self.flush()  # what may take long
        with deferred():
            self._close(self.status)
            with warnings.catch_warnings():  # raises if the last bytes did not reach the disk: the footer is missing
                warnings.simplefilter("error", RerunWarning)
                RrdReader(self.part)
            os.replace(self.part, self.path)

    def _close(self, status: str) -> None:
        self.send_property("run", {"status": status})
        self.flush()
        self.stream.disconnect()  # not after a failed flush: it would wait for a writer that is gone

    def send(self, entities: Entities, static: bool = False) -> None:
        """Log pairs (entity path, archetype)."""
        for path, archetype in entities:
            self.stream.log(path, archetype, static=static)

    def write(self, columns: Columns, least_bytes: int = 0) -> None:
        """Send what waits in columns, see `Columns.write`.

        An interruption waits meanwhile: frames are then whole in the file, and nothing is sent twice.
        """
        with deferred():
            columns.write(self.stream, least_bytes)

    def send_numbers(self, name: str, numbers: Mapping[str, float]) -> None:
        """Set a property's keys to numbers, as float64 whatever they are, so that many recordings make one table."""
        self.send_property(name, {key: float(value) for key, value in numbers.items()})

    def send_property(self, name: str, values: Mapping[str, Any]) -> None:
        """Set a property's keys; those sent earlier under other keys stay."""
        if values:
            self.stream.send_property(name, arrow(values))

    def warn(self, sentence: str) -> None:
        """Log a sentence, which also waits in `warnings` to be recorded."""
        logger.warning(sentence)
        self.warnings.append(sentence)

    def check_space(self) -> None:
        """Raise OSError when there is less room than what is there takes, within bounds.

        Rerun's writer never comes back from a full disk, so the run ends while there is room to close the file.
        """
        if (room := self._room()) < min(max(self.part.stat().st_size, _LEAST_BYTES), _MOST_BYTES):
            words = f"only {room / 1e6:.1f} MB are left for it on the disk, the recording ends here"
            raise OSError(errno.ENOSPC, words, str(self.part))

    def flush(self) -> None:
        """Bring what was logged to the disk; raises OSError when that fails."""
        if self.is_streaming and self._sender is not None and self._sender.poll() is not None:
            self._leave_viewer(f"the viewer at {HOST}:{PORT} does not answer")
        began = monotonic()
        while True:
            try:
                return self.stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            except RuntimeError as error:
                full = self._room() < resource.getpagesize()
                if full or monotonic() - began > _LONGEST_WRITE_S:
                    give_up(self.stream)
                    words = "no room is left for it on the disk" if full else f"writing failed, {error}"
                    raise OSError(errno.ENOSPC if full else errno.EIO, words, str(self.part)) from None

    def _room(self) -> int:
        """Return how many bytes the file may still grow by."""
        limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
        free = shutil.disk_usage(self.part.parent).free
        return free if limit == resource.RLIM_INFINITY else min(free, limit - self.part.stat().st_size)

    def _leave_viewer(self, reason: str) -> None:
        self.is_streaming = False
        self.warn(f"{reason}: recording to the file only")


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


@contextmanager
def written_file(
    path: Path, application: str, recording: str, layout: rrb.Blueprint | None = None, **options: Any
) -> Iterator[rr.RecordingStream]:
    """Write what the block sends to a stream into an .rrd with this layout."""
    stream = new_stream(application, recording, **options)
    stream.set_sinks(rr.FileSink(path), default_blueprint=layout)
    yield stream
    stream.flush()
    stream.disconnect()


def give_up(stream: rr.RecordingStream) -> None:
    """Keep Rerun from waiting for a stream's writer that has failed, now or as the process ends.

    Rerun waits when the stream is deleted, which a thread that never ends prevents, and in its handler at exit.
    """
    _given_up.append(stream)
    Thread(target=lambda _: Event().wait(), args=(stream,), daemon=True, name="holds a stream given up").start()
    rr.unregister_shutdown()


def viewer_listens() -> bool:
    """Return whether something accepts connections there; without a listener, sending blocks for seconds."""
    try:
        socket.create_connection((HOST, PORT), timeout=0.5).close()
    except OSError:
        return False
    return True


def arrow(values: Mapping[str, Any]) -> rr.AnyValues:
    """Make a component each of strings, numbers and lists or arrays of them, none empty; float64 stays float64.

    As Arrow arrays: AnyValues would hold every later run of the process to the first one's types.
    """
    columns = {key: pa.array(np.atleast_1d(np.asarray(value)).tolist()) for key, value in values.items()}
    return rr.AnyValues(**columns)
