"""Recordings that were written leave nothing behind in the process that wrote them; cards show what cameras saw."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
from small_recordings import record

from workbench.recording.read.reader import read
from workbench.recording.side_by_side import write_names, write_side_by_side
from workbench.recording.write import file as files
from workbench.recording.write.cards import preview_of, write_card
from workbench.recording.write.file import RecordingFile, abandon, new_stream

TASKS = Path("/proc/self/task")


@pytest.fixture
def two(tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda *_: set())
    return [record(tmp_path / f"{name}.rrd", name) for name in "ab"]


def a_run(folder, two):
    with RecordingFile(folder / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}):
        pass


def side_by_side(folder, two):
    write_side_by_side(folder / "both.rrd", *map(read, two))


def names(folder, two):
    write_names(folder, two, ["one", "other"])


def a_card(folder, two):
    write_card(folder / "card.rrd", ("workbench", "a"), {"rank": 0.0}, {"seed": 1}, {"prior": "smooth"})


@pytest.mark.skipif(not TASKS.is_dir(), reason="the system does not tell a process's threads")
@pytest.mark.parametrize("write", [a_run, side_by_side, names, a_card])
def test_the_next_recording_lets_go_of_those_before(write, two, tmp_path):
    """But for the layout's, of which only Rerun knows: two threads for each."""
    left = 2 * 5 * (write is side_by_side)
    for _ in range(2):
        write(tmp_path, two)
    before = len(os.listdir(TASKS))
    for _ in range(5):
        write(tmp_path, two)
    assert len(os.listdir(TASKS)) <= before + left


def test_what_is_being_written_is_kept(tmp_path):
    with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="seed: 0", provenance={"seed": 0}) as file:
        a_card(tmp_path, None)
        file.send_numbers("metrics", {"mpjpe_abs_mm": 2.5})
    assert read(tmp_path / "run.rrd").result == {"mpjpe_abs_mm": 2.5}


def test_no_stream_is_freed_once_one_was_given_up(monkeypatch):
    """Rerun would wait for its writer."""
    monkeypatch.setattr(files, "_abandoned", [])
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: None)
    monkeypatch.setattr(rr, "init", lambda *_, **__: pytest.fail("it would wait"))
    abandon(rr.RecordingStream("a", recording_id="a"))
    new_stream("b", "b")


FULL = """
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
    print("gave up")
"""


def test_a_process_ends_whose_stream_cannot_be_written(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", FULL, tmp_path / "run.rrd"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (0, "gave up\n"), done.stderr


PNG = cv2.imencode(".png", np.zeros((6, 8), dtype=np.uint8))[1].tobytes()


def test_a_preview_is_of_what_a_camera_saw(tmp_path):
    with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="{}", settings={}, provenance={}) as file:
        file.stream.set_time("frame", sequence=0)
        for place in ("posterior/pictures/knee/mass", "world/right/image", "world/left/image"):
            file.stream.log(place, rr.EncodedImage(contents=PNG, media_type="image/png"))
    assert preview_of(tmp_path / "run.rrd") == (["/world/left/image", "/world/right/image"], False)


def test_a_recording_that_was_cut_off_has_none(tmp_path):
    (tmp_path / "run.rrd").write_bytes(b"RRF2")
    assert preview_of(tmp_path / "run.rrd") == ([], False)
