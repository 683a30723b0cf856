"""Rows written as columns are what archetypes logged frame by frame would have been."""

import os
import signal

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from workbench.recording.write.columns import Columns, Row, curves
from workbench.recording.write.file import RecordingFile
from workbench.utils.signals import Interrupted, interruptible

RNG = np.random.default_rng(0)


def bars():
    return {"values": RNG.random(32)}


def strips(n):
    return {"strips": RNG.random((n, 5, 3)).astype(np.float32), "colors": RNG.integers(0, 255, (n, 3), dtype=np.uint8)}


def jpeg(size):
    return {"blob": [RNG.integers(0, 255, size, dtype=np.uint8)], "media_type": ["image/jpeg"]}


ROWS = {
    "bars": (rr.BarChart, [bars(), bars(), bars()]),
    "strips, none in one frame": (rr.LineStrips3D, [strips(4), strips(0), strips(1)]),
    "flat strips": (rr.LineStrips2D, [{"strips": flat} for flat in RNG.random((2, 6, 4, 2)).astype(np.float32)]),
    "strips, none at all": (rr.LineStrips3D, [{"strips": np.empty((0, 5, 3), dtype=np.float32)}] * 2),
    "points": (rr.Points3D, [{"positions": RNG.random((3, 3))}, {"positions": RNG.random((2, 3))}]),
    "curves": (rr.Scalars, [{"scalars": RNG.random(25)}, {"scalars": RNG.random(25)}]),
    "images": (rr.EncodedImage, [jpeg(100), jpeg(7)]),
}


def logged(path, write):
    """{frame: {component: value}} of what `write(stream)` leaves at the entity `it` of a file."""
    stream = rr.RecordingStream("test", recording_id="rows", batcher_config=rr.ChunkBatcherConfig.NEVER())
    stream.set_sinks(rr.FileSink(path))
    write(stream)
    stream.disconnect()
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path == "/it":
            batch = chunk.to_record_batch()
            frames = np.asarray(batch.column("frame"), dtype=np.int64).tolist()
            for name in [name for name in batch.schema.names if ":" in name]:  # a component, no index
                values = dict(zip(frames, batch.column(name).to_pylist(), strict=True))
                for frame, value in values.items():
                    found.setdefault(frame, {}).update({name: value} if value is not None else {})
    return found


@pytest.mark.parametrize(("kind", "fields"), ROWS.values(), ids=ROWS.keys())
def test_columns_hold_what_archetypes_hold(tmp_path, kind, fields):
    def one_by_one(stream):
        for frame, given in enumerate(fields):
            stream.set_time("frame", sequence=frame)
            stream.set_time("time", duration=np.timedelta64(frame, "s"))
            stream.log("it", kind.from_fields(**given))

    def at_once(stream):
        columns = Columns()
        for frame, given in enumerate(fields):
            columns.add(frame, np.timedelta64(frame * 10**9, "ns"), [("it", Row(kind, given))])
        columns.write(stream)
        columns.write(stream)  # nothing waits any more

    expected, found = (logged(tmp_path / f"{write.__name__}.rrd", write) for write in (one_by_one, at_once))
    assert len(expected) == len(fields)
    assert all(expected.values())
    assert found == expected


def test_numbers_are_the_curves_that_they_would_have_been(tmp_path):
    """Also where not every frame has them all."""
    values = [{"it": 0.1}, {"it": np.nan, "other": 3.0}, {"it": -1e-300}]

    def as_rows(stream):
        columns = Columns()
        for frame, numbers in enumerate(values):
            columns.add(frame, np.timedelta64(frame * 10**9, "ns"), curves(numbers))
        columns.write(stream)

    def as_numbers(stream):
        columns = Columns()
        for frame, numbers in enumerate(values):
            columns.add_numbers(frame, np.timedelta64(frame * 10**9, "ns"), numbers)
        columns.write(stream)
        columns.write(stream)  # nothing waits any more

    expected, found = (logged(tmp_path / f"{write.__name__}.rrd", write) for write in (as_rows, as_numbers))
    assert len(expected) == 3
    assert repr(sorted(found.items())) == repr(sorted(expected.items()))  # where NaN is NaN


class InterruptedStream:
    """A stream that is told nothing but what paths are sent, in whose second a signal asks the process to end."""

    def __init__(self):
        self.sent = []

    def send_columns(self, path, **_):
        self.sent.append(path)
        if len(self.sent) == 2:
            os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("kind", ["rows", "numbers", "large rows"])
def test_what_was_being_written_when_asked_to_end_is_there_once(kind, tmp_path):
    """Whoever closes a recording writes what waits: a run that goes on with it would count a frame twice."""
    columns, stream, paths = Columns(), InterruptedStream(), ["a", "b", "c"]
    file = RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="", provenance={})
    file.stream = stream
    for frame in range(2):
        time = np.timedelta64(frame, "s")
        if kind == "numbers":
            columns.add_numbers(frame, time, dict.fromkeys(paths, 1.0))
        else:
            columns.add(frame, time, curves(dict.fromkeys(paths, 1.0)))
    with pytest.raises(Interrupted), interruptible():
        file.write(columns, min_bytes=int(kind == "large rows"))
    columns.write(stream)
    assert sorted(stream.sent) == paths
