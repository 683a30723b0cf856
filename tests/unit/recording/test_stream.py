"""Recordings that were written leave nothing behind in the process that wrote them."""

import os
from pathlib import Path

import pytest
import rerun as rr
from rerun import bindings
from small_recordings import record

from workbench.recording.compare.side_by_side import write_names, write_side_by_side
from workbench.recording.read.reader import read
from workbench.recording.write import stream
from workbench.recording.write.cards import write_card
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.stream import abandon, new_stream

TASKS = Path("/proc/self/task")


@pytest.fixture
def two(tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda *_: set())
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
        file.send_numbers("metrics", {"error_abs_mm": 2.5})
    assert read(tmp_path / "run.rrd").result == {"error_abs_mm": 2.5}


def test_nothing_is_waited_for_once_a_writer_is_gone(monkeypatch):
    monkeypatch.setattr(stream, "_abandoned", [])
    monkeypatch.setattr(
        bindings, "flush_and_cleanup_orphaned_recordings", lambda: pytest.fail("it would wait for ever")
    )
    abandon(rr.RecordingStream("a", recording_id="a"))
    new_stream("b", "b")
