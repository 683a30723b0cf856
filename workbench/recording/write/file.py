"""One Rerun file per run, published only when the run ends well."""

import logging
import os
import platform
import re
import shutil
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr
from llvmlite.binding import get_host_cpu_name  # type: ignore[import-untyped]
from rerun.chunk import RrdReader

from workbench.errors import InputError
from workbench.recording.write.columns import Entities

logger = logging.getLogger(__name__)

FORMAT = 2
"""The version of what a recording holds and where, in the property `run`; raised whenever a reader must know.

1, without a number: up to the release before there was one. 2: `run` has the keys format and platform.
"""

HOST, PORT = "127.0.0.1", 9876
"""Where `rerun` listens unless told otherwise."""
_SPARE_BYTES = 100_000_000  # many times what is written between two flushes
_LONGEST_WRITE_S = 120.0


class RecordingFile:
    """Rerun's stream into `path`, an .rrd, with the properties that every recording of ours has.

    A context manager. While it is open the file is called `<path>.part` and is readable up to the last flush, even
    when the process is killed. On a clean exit it becomes `path`; on an exception the .part is completed and kept,
    and nothing is published. The property `run` says which of these happened (status: running, failed, complete).
    Older files of these names are replaced.

    stream: what to log to. run_id: unique per run. config_yaml: the resolved config. provenance: where the run came
    from (seed, versions). live: send everything to a viewer too, if one listens at 127.0.0.1:9876; it turns False
    when none does. warnings: sentences that were told and wait to be recorded.
    """

    def __init__(
        self, path: str | Path, *, run_id: str, config_yaml: str, provenance: Mapping[str, Any],
        live: bool = False,
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.live, self._viewer_is_gone = live, False
        self.warnings: list[str] = []
        self._run_id, self._config_yaml, self._provenance = run_id, config_yaml, provenance
        rr.set_strict_mode(True)
        # Without a batcher a chunk ends where we flush, so that equal runs give equal chunks.
        never = rr.ChunkBatcherConfig.NEVER()
        # Recordings of one application would share their layout in the viewer; in other letters Rerun warns
        application = re.sub(r"[^A-Za-z0-9_-]", "-", run_id)
        self.stream = rr.RecordingStream(application, recording_id=run_id, batcher_config=never)
        self.stream.set_log_time_enabled(False)

    def __enter__(self) -> Self:
        self.part.parent.mkdir(parents=True, exist_ok=True)
        sinks: list[Any] = [rr.FileSink(self.part)]
        if self.live and viewer_listens():
            sinks.append(rr.GrpcSink(f"rerun+http://{HOST}:{PORT}/proxy"))
        elif self.live:
            self.live = False
            self.warn(f"no viewer listens at {HOST}:{PORT}: recording to the file only")
        try:
            self.stream.set_sinks(*sinks)
        except RuntimeError as error:
            raise InputError(f"{self.part}: cannot be written: {error}") from None
        # the operating system and the processor, on which the last bits of results depend
        machine = f"{platform.system()} {platform.machine()} {get_host_cpu_name()}"
        self.send_property("run", {"id": self._run_id, "status": "running", "format": FORMAT, "platform": machine})
        self.send_property("provenance", self._provenance)
        self.stream.send_property("config", rr.TextDocument(self._config_yaml, media_type="text/plain"))
        self.flush()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.send_property("run", {"status": "complete" if kind is None else "failed"})
        self.flush()
        self.stream.disconnect()  # not after a failed flush: it would wait for a writer that is gone
        if kind is not None:
            logger.warning("the run ended early; what was recorded until then is in %s", self.part)
            return
        RrdReader(self.part).store()  # raises if the last bytes did not reach the disk
        os.replace(self.part, self.path)

    def send(self, entities: Entities, static: bool = False) -> None:
        """Log pairs (entity path, archetype)."""
        for path, archetype in entities:
            self.stream.log(path, archetype, static=static)

    def send_property(self, name: str, values: Mapping[str, Any]) -> None:
        """Set a property's keys; those sent earlier under other keys stay."""
        if values:
            self.stream.send_property(name, arrow(values))

    def check_space(self) -> None:
        """Raise OSError when the disk is nearly full.

        Rerun's writer never comes back from a full disk, so the run ends while there is room to close the file.
        """
        if (free := shutil.disk_usage(self.part.parent).free) < _SPARE_BYTES:
            raise OSError(f"{self.part}: only {free / 1e6:.0f} MB are left on the disk, the recording ends here")

    def flush(self) -> None:
        """Bring what was logged to the disk; raises OSError when that fails. A viewer that has left is told once."""
        try:
            self.stream.flush(timeout_sec=_LONGEST_WRITE_S)
        except RuntimeError as error:
            if not self.live or "gRPC" not in str(error):
                raise OSError(f"{self.part}: writing failed, {error}") from error
            if not self._viewer_is_gone:
                self.warn(f"the viewer at {HOST}:{PORT} is gone: recording to the file only")
            self._viewer_is_gone = True

    def warn(self, sentence: str) -> None:
        """Tell a sentence, which waits in `warnings` to be recorded."""
        logger.warning(sentence)
        self.warnings.append(sentence)


def viewer_listens(timeout_s: float = 0.5) -> bool:
    """Tell whether something accepts connections there; asked first, since sending to nobody blocks for seconds."""
    try:
        socket.create_connection((HOST, PORT), timeout_s).close()
    except OSError:
        return False
    return True


def arrow(values: Mapping[str, Any]) -> rr.AnyValues:
    """Make a component each of strings, numbers and lists or arrays of them, none empty; float64 stays float64.

    As Arrow arrays: AnyValues would hold every later run of the process to the first one's types.
    """
    columns = {key: pa.array(np.atleast_1d(np.asarray(value)).tolist()) for key, value in values.items()}
    return rr.AnyValues(**columns)
