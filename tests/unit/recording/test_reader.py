"""Recordings read back: whole, cut off, torn, rewritten, or not recordings at all."""

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun_cli
from recording_steps import BODY, SCALE, SPACE, errors, steps

from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("reader") / "run.rrd"
    given = {"config_yaml": "seed: 3", "provenance": {"seed": 3}, "coefficient_scale": SCALE}
    with Recorder(path, BODY, SPACE, run_id="read", **given) as recording:
        for step in steps(12, n_particles=30):
            recording.log(step, errors(step))
        recording.set_result({"error_mm": 1.0})
    return path


def optimize(path, out):
    rerun = Path(rerun_cli.__file__).with_name("rerun")
    environment = {**os.environ, "RERUN_ANALYTICS": "false"}
    subprocess.run([rerun, "rrd", "optimize", path, "-o", out], check=True, capture_output=True, env=environment)
    return out


def same(first, second):
    assert first.properties == second.properties
    assert first.scalars.keys() == second.scalars.keys()
    for path, curve in first.scalars.items():
        assert curve.frames.tolist() == second.scalars[path].frames.tolist()
        assert curve.values.tobytes() == second.scalars[path].values.tobytes()
    assert first.marginals.log_mass.tobytes() == second.marginals.log_mass.tobytes()


def test_a_rewritten_recording_says_the_same(recorded, tmp_path):
    # The tool merges chunks: several rows of a property, of a picture and of a curve end up in one.
    same(read(recorded), read(optimize(recorded, tmp_path / "optimized.rrd")))


def test_names_and_shapes(recorded):
    run = read(recorded)
    assert run.metric_names == ("error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs")
    frames, values = run.metric("log_evidence")
    assert frames.tolist() == list(range(10, 22))
    assert values.tolist() == [-3.0 * k for k in range(1, 13)]
    assert run.poses[1].shape == (12, 25)
    assert run.marginals.names[:5] == ("c1", "c2", "c3", "c4", "c5")
    assert run.marginals.units[5:7] == ("cycle", "cycle/s")
    assert (run.marginals.low < run.marginals.high).all()


def test_a_metric_that_is_not_there(recorded):
    with pytest.raises(InputError, match=r"error_px.*ess"):
        read(recorded).metric("error_px")


def test_a_run_without_a_frame(tmp_path):
    with Recorder(tmp_path / "run.rrd", BODY, SPACE, run_id="none", config_yaml="", provenance={}):
        pass
    run = read(tmp_path / "run.rrd")
    assert run.poses[1].shape == (0, 25)
    assert run.metric_names == ()
    assert run.marginals is None


def test_no_such_file(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.rrd: no such recording"):
        read(tmp_path / "nothing.rrd")


@pytest.mark.parametrize("junk", [b"", b"RRF2", b"hello " * 1000, bytes(range(256)) * 40])
def test_a_file_that_is_no_recording(tmp_path, junk):
    path = tmp_path / "junk.rrd"
    path.write_bytes(junk)
    with pytest.raises(InputError, match=r"junk\.rrd: expected"):
        read(path)


def test_a_folder(tmp_path):
    with pytest.raises(InputError, match="no such recording"):
        read(tmp_path)


def test_a_recording_of_something_else(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.set_sinks(rr.FileSink(tmp_path / "other.rrd"))
    stream.log("x", rr.Scalars(1.0))
    stream.flush()
    stream.disconnect()
    with pytest.raises(InputError, match="without the property 'run'"):
        read(tmp_path / "other.rrd")


def test_a_torn_recording_says_how_to_save_the_rest(recorded, tmp_path):
    torn = tmp_path / "torn.rrd"
    whole = recorded.read_bytes()
    torn.write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(InputError, match="rerun rrd optimize"):
        read(torn)
    saved = read(optimize(torn, tmp_path / "saved.rrd"))
    assert saved.config == "seed: 3"
    frames, poses = saved.poses
    expected = read(recorded).poses[1]
    assert len(frames) >= 10  # the first flush came before the tear
    assert np.array_equal(poses, expected[: len(frames)])


def message_ends(content):
    """Where the messages of a recording end: after 12 bytes each has 16, with its length as the last 8, and itself."""
    ends = [12]
    while (header := content[ends[-1] : ends[-1] + 16]) and not header.startswith(bytes(8)):  # 0 is the footer
        ends.append(ends[-1] + 16 + struct.unpack("<8xQ", header)[0])
    return ends


def test_a_recording_cut_anywhere_is_told_as_cut(recorded, tmp_path):
    """Between two messages Rerun itself reads what is left without complaint, and so it does without the last bytes."""
    cut, content = tmp_path / "cut.rrd", recorded.read_bytes()
    shutil.copy(recorded, cut)
    ends = [end + k for end in message_ends(content)[1::7] for k in (-1, 0, 15, 16)]
    last = [len(content) - k for k in (1, 4, 31, 32, 33, 48)]
    for size in sorted([*ends, *range(len(content) // 9, len(content), len(content) // 9), *last], reverse=True):
        os.truncate(cut, size)
        with pytest.raises(InputError, match=r"cut\.rrd: expected a whole Rerun recording"):
            read(cut)


def test_what_a_killed_run_left_is_read_without_an_end(recorded, tmp_path):
    part, content = tmp_path / "run.rrd.part", recorded.read_bytes()
    part.write_bytes(content[: message_ends(content)[-1]])
    assert read(part).poses[1].tobytes() == read(recorded).poses[1].tobytes()
