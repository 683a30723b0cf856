"""What continues a run is read back bit by bit, takes a tenth of the file at most, and is not trusted."""

import io
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from recorded import record
from recording_steps import BODY, SPACE, steps

from workbench.core.filter_state import FilterState
from workbench.recording.read import partial_run as reading
from workbench.recording.read.partial_run import checkpoint_frames, past_before
from workbench.recording.read.reader import read
from workbench.recording.write import checkpoints
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError


def decode(state):
    """Poses that are not those of the steps, which are then stored."""
    return np.zeros((len(state), 25))


def with_memory(step, late=False, parents=None):
    rng = np.random.default_rng(step.frame.index)
    log_weights = np.where(rng.random(len(step.log_weights)) < 0.5, -np.inf, step.log_weights)
    arrays = {"state": step.particles, "poses": step.poses, "log_weights": log_weights, "ahead": np.array([3])}
    expected = step.expected_pose + 1.0 if late else step.expected_pose
    return replace(step, filter_state=FilterState(arrays, expected, {"prior": rng.bit_generator.state}, parents))


def recorded(path, run, decode=decode, **options):
    return read(record(path, run, checkpoints=True, decode=decode, **options))


@pytest.mark.parametrize("late", [False, True])
def test_what_was_stored_comes_back(tmp_path, monkeypatch, late):
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    run = [with_memory(step, late) for step in steps(8, n_particles=60)]
    found = recorded(tmp_path / "run.rrd", run)
    assert checkpoint_frames(found) == [10, 11, 12, 13, 14, 15, 16]  # what follows on the last is not known
    assert past_before(found, 10) is None
    for frame, last in ((11, 0), (14, 3), (99, 6)):
        past = past_before(found, frame)
        np.testing.assert_array_equal(
            past.filtered_poses, [step.filter_state.filtered_pose for step in run[: last + 1]]
        )
        assert past.filter_state.rng_states == run[last].filter_state.rng_states
        assert past.filter_state.arrays.keys() == run[last].filter_state.arrays.keys()
        for name, array in run[last].filter_state.arrays.items():
            np.testing.assert_array_equal(past.filter_state.arrays[name], array)


def test_states_that_nobody_came_from_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    run = [with_memory(step, parents=np.repeat([3, 7], 30)) for step in steps(2, n_particles=60)]
    arrays = past_before(recorded(tmp_path / "run.rrd", run), 99).filter_state.arrays
    for name in ("state", "poses"):
        assert np.flatnonzero(arrays[name].any(axis=1)).tolist() == [3, 7]
        np.testing.assert_array_equal(arrays[name][[3, 7]], run[0].filter_state.arrays[name][[3, 7]])
    np.testing.assert_array_equal(arrays["log_weights"], run[0].filter_state.arrays["log_weights"])


@pytest.mark.parametrize("n_particles", [60, 600])
@pytest.mark.slow
def test_they_take_a_tenth_of_the_file_at_most(tmp_path, n_particles, monkeypatch):
    monkeypatch.setattr("workbench.recording.write.recorder.MAX_FLUSH_EVERY", 3)
    run = list(steps(40, n_particles=n_particles))
    plain = recorded(tmp_path / "plain.rrd", run)
    full = recorded(tmp_path / "full.rrd", map(with_memory, run))
    assert not checkpoint_frames(plain)
    assert checkpoint_frames(full)
    size = full.path.stat().st_size
    assert 0 < size - plain.path.stat().st_size <= 0.1 * size


def damaged(path, packed, streams="{}"):
    """A recording whose checkpoint holds something else."""
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(2, n_particles=20):
            recorder.log(step, {})
        fields = {"npz": pa.array([packed], pa.binary()), "streams": pa.array([streams])}
        recorder._stream.log(checkpoints.MEMORY, rr.DynamicArchetype(checkpoints.ARCHETYPE, components=fields))
    return read(path)


def npz(**arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


OBJECTS = npz(state=np.array([{"a": 1}], dtype=object))


@pytest.mark.parametrize(
    ("packed", "streams"),
    [
        (b"nothing", "{}"),
        (npz(state=np.zeros(3))[:-9], "{}"),
        (OBJECTS, "{}"),
        (npz(state=np.zeros(100_000)), "{}"),
        (npz(state=np.zeros(3)), "[]"),
        (npz(state=np.zeros(3)), '{"prior": 3}'),
        (npz(state=np.zeros(3)), "{" * 100_000),
    ],
    ids=["no archive", "cut off", "objects", "too large", "a list", "no state", "deep"],
)
def test_a_damaged_checkpoint_is_a_sentence(tmp_path, monkeypatch, packed, streams):
    monkeypatch.setattr(reading, "_MAX_BYTES", 500_000)
    found = damaged(tmp_path / "run.rrd", packed, streams)
    with pytest.raises(InputError, match=r"run.rrd: checkpoint of frame 11"):
        past_before(found, 99)
