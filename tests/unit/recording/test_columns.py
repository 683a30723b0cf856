"""Rows written as columns equal archetypes that are logged frame by frame."""

import os
import signal

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from workbench.recording.write.columns import Columns, Row
from workbench.recording.write.file import RecordingFile
from workbench.utils.signals import Interrupted, interruptible

RNG = np.random.default_rng(0)


def curves(numbers):
    return [(path, Row(rr.Scalars, {"scalars": np.array([value])})) for path, value in numbers.items()]


def bars():
    return {"values": RNG.random(32)}


def strips(n):
    return {"strips": RNG.random((n, 5, 3)).astype(np.float32), "colors": RNG.integers(0, 255, (n, 3), dtype=np.uint8)}


def jpeg(size):
    return {"blob": [RNG.integers(0, 255, size, dtype=np.uint8)], "media_type": ["image/jpeg"]}


ROWS = {
    "bars": (rr.BarChart, [bars(), bars(), bars()]),
    "strips, one frame empty": (rr.LineStrips3D, [strips(4), strips(0), strips(1)]),
    "flat strips": (rr.LineStrips2D, [{"strips": flat} for flat in RNG.random((2, 6, 4, 2)).astype(np.float32)]),
    "strips, all frames empty": (rr.LineStrips3D, [{"strips": np.empty((0, 5, 3), dtype=np.float32)}] * 2),
    "points": (rr.Points3D, [{"positions": RNG.random((3, 3))}, {"positions": RNG.random((2, 3))}]),
    "curves": (rr.Scalars, [{"scalars": RNG.random(25)}, {"scalars": RNG.random(25)}]),
    "images": (rr.EncodedImage, [jpeg(100), jpeg(7)]),
}


def logged(path, write):
    """Return {frame: {component: value}} of the entity `it` in the file that `write(stream)` writes."""
    stream = rr.RecordingStream("test", recording_id="rows", batcher_config=rr.ChunkBatcherConfig.NEVER())
    stream.set_sinks(rr.FileSink(path))
    write(stream)
    stream.disconnect()
    frames_read = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path == "/it":
            batch = chunk.to_record_batch()
            frames = np.asarray(batch.column("frame"), dtype=np.int64).tolist()
            components = [name for name in batch.schema.names if ":" in name]  # indices have no colon
            for name in components:
                values = dict(zip(frames, batch.column(name).to_pylist(), strict=True))
                for frame, value in values.items():
                    frames_read.setdefault(frame, {}).update({name: value} if value is not None else {})
    return frames_read


@pytest.mark.parametrize(("kind", "fields"), ROWS.values(), ids=ROWS.keys())
def test_columns_equal_logged_archetypes(tmp_path, kind, fields):
    def frame_by_frame(stream):
        for frame, values in enumerate(fields):
            stream.set_time("frame", sequence=frame)
            stream.set_time("time", duration=np.timedelta64(frame, "s"))
            stream.log("it", kind.from_fields(**values))

    def as_columns(stream):
        columns = Columns()
        for frame, values in enumerate(fields):
            columns.add(frame, np.timedelta64(frame * 10**9, "ns"), [("it", Row(kind, values))])
        columns.write(stream)
        columns.write(stream)  # writes nothing: no row is pending

    expected, written = (logged(tmp_path / f"{write.__name__}.rrd", write) for write in (frame_by_frame, as_columns))
    assert len(expected) == len(fields)
    assert all(expected.values())
    assert written == expected


def test_numbers_equal_the_curves_of_the_same_values(tmp_path):
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
        columns.write(stream)  # writes nothing: no row is pending

    expected, written = (logged(tmp_path / f"{write.__name__}.rrd", write) for write in (as_rows, as_numbers))
    assert len(expected) == 3
    assert repr(sorted(written.items())) == repr(sorted(expected.items()))  # NaN equals NaN as text


class InterruptedStream:
    """A stream that lists the paths sent to it; the second one raises SIGTERM in the process."""

    def __init__(self):
        self.sent = []

    def send_columns(self, path, **_):
        self.sent.append(path)
        if len(self.sent) == 2:
            os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("kind", ["rows", "numbers", "large rows"])
def test_an_interrupted_write_sends_each_row_once(kind, tmp_path):
    """Closing the recording writes the pending rows; a duplicate row would count a frame twice."""
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
