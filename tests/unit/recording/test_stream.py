"""Writing a recording leaves no threads behind, and writing another one at the same time does not end it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import rerun as rr
from small_recordings import record

from workbench.recording.read.reader import read
from workbench.recording.side_by_side import write_side_by_side
from workbench.recording.write import file as files
from workbench.recording.write.file import RecordingFile, abandon, new_stream

TASKS = Path("/proc/self/task")


@pytest.fixture
def recordings(tmp_path, trusted):
    return [record(tmp_path / f"{name}.rrd", name) for name in "ab"]


def write_run(folder, recordings):
    with RecordingFile(folder / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}):
        pass


def write_comparison(folder, recordings):
    write_side_by_side(folder / "both.rrd", *map(read, recordings))


@pytest.mark.skipif(not TASKS.is_dir(), reason="the system does not list the threads of a process")
@pytest.mark.parametrize("write", [write_run, write_comparison])
def test_a_new_recording_ends_the_threads_of_earlier_ones(write, recordings, tmp_path):
    """Rerun does not end the two threads of a layout."""
    remaining = 2 * 5 * (write is write_comparison)
    for _ in range(2):
        write(tmp_path, recordings)
    before = len(os.listdir(TASKS))
    for _ in range(5):
        write(tmp_path, recordings)
    assert len(os.listdir(TASKS)) <= before + remaining


def test_another_file_does_not_end_the_recording_that_is_being_written(recordings, tmp_path):
    with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}) as file:
        write_comparison(tmp_path, recordings)
        file.send_numbers("metrics", {"mpjpe_abs_mm": 2.5})
    assert read(tmp_path / "run.rrd").result == {"mpjpe_abs_mm": 2.5}


def test_no_stream_is_freed_after_one_is_abandoned(monkeypatch):
    """Rerun would wait for its writer forever."""
    monkeypatch.setattr(files, "_abandoned", [])
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: None)
    monkeypatch.setattr(rr, "init", lambda *_, **__: pytest.fail("waits for the writer"))
    abandon(rr.RecordingStream("a", recording_id="a"))
    new_stream("b", "b")


FULL_DISK = """
import resource, signal, sys
import numpy as np
import rerun as rr
from workbench.recording.write.file import abandon, new_stream
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
stream = new_stream("a", "a", batcher_config=rr.ChunkBatcherConfig.NEVER())
stream.set_sinks(rr.FileSink(sys.argv[1]))
for _ in range(20):
    stream.log("a", rr.Tensor(np.random.default_rng(0).random((200, 100))))
try:
    stream.flush(timeout_sec=1.0)
except RuntimeError:
    abandon(stream)
    print("abandoned")
"""


def test_a_process_exits_although_its_stream_cannot_be_written(tmp_path):
    process = subprocess.run(
        [sys.executable, "-c", FULL_DISK, tmp_path / "run.rrd"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (process.returncode, process.stdout) == (0, "abandoned\n"), process.stderr
