"""Checkpoints are read back bitwise, take at most a tenth of the file, and are checked before use."""

import io
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from recorded import record
from recording_steps import BODY, SPACE, steps

from workbench.core.filter_state import FilterState
from workbench.recording.read import partial_run
from workbench.recording.read.partial_run import checkpoint_frames, past_before
from workbench.recording.read.reader import read
from workbench.recording.write import checkpoints
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError


def decode(state):
    """Return poses that differ from those of the steps, so that a checkpoint stores the steps' poses."""
    return np.zeros((len(state), 25))


def with_filter_state(step, delayed=False, parents=None):
    """Return the step with a filter state; delayed: its filtered pose is not the expected pose."""
    rng = np.random.default_rng(step.frame.index)
    log_weights = np.where(rng.random(len(step.log_weights)) < 0.5, -np.inf, step.log_weights)
    arrays = {"state": step.particles, "poses": step.poses, "log_weights": log_weights, "ahead": np.array([3])}
    expected = step.expected_pose + 1.0 if delayed else step.expected_pose
    return replace(step, filter_state=FilterState(arrays, expected, {"prior": rng.bit_generator.state}, parents))


def recorded(path, run, decode=decode, **options):
    return read(record(path, run, checkpoints=True, decode=decode, **options))


@pytest.mark.parametrize("delayed", [False, True])
def test_stored_filter_states_are_read_back(tmp_path, monkeypatch, delayed):
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    run = [with_filter_state(step, delayed) for step in steps(8, n_particles=60)]
    recording = recorded(tmp_path / "run.rrd", run)
    assert checkpoint_frames(recording) == [10, 11, 12, 13, 14, 15, 16]  # the last step has no known offspring
    assert past_before(recording, 10) is None
    for frame, last in ((11, 0), (14, 3), (99, 6)):
        past = past_before(recording, frame)
        np.testing.assert_array_equal(
            past.filtered_poses, [step.filter_state.filtered_pose for step in run[: last + 1]]
        )
        assert past.filter_state.rng_states == run[last].filter_state.rng_states
        assert past.filter_state.arrays.keys() == run[last].filter_state.arrays.keys()
        for name, array in run[last].filter_state.arrays.items():
            np.testing.assert_array_equal(past.filter_state.arrays[name], array)


def test_particles_without_offspring_are_omitted(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    run = [with_filter_state(step, parents=np.repeat([3, 7], 30)) for step in steps(2, n_particles=60)]
    arrays = past_before(recorded(tmp_path / "run.rrd", run), 99).filter_state.arrays
    for name in ("state", "poses"):
        assert np.flatnonzero(arrays[name].any(axis=1)).tolist() == [3, 7]
        np.testing.assert_array_equal(arrays[name][[3, 7]], run[0].filter_state.arrays[name][[3, 7]])
    np.testing.assert_array_equal(arrays["log_weights"], run[0].filter_state.arrays["log_weights"])


@pytest.mark.parametrize("n_particles", [60, 600])
@pytest.mark.slow
def test_checkpoints_take_at_most_a_tenth_of_the_file(tmp_path, n_particles, monkeypatch):
    monkeypatch.setattr("workbench.recording.write.recorder.FLUSH_S", np.inf)
    monkeypatch.setattr("workbench.recording.write.recorder.MAX_FLUSH_EVERY", 3)
    run = list(steps(40, n_particles=n_particles))
    plain = recorded(tmp_path / "plain.rrd", run)
    full = recorded(tmp_path / "full.rrd", map(with_filter_state, run))
    assert not checkpoint_frames(plain)
    assert checkpoint_frames(full)
    size = full.path.stat().st_size
    assert 0 < size - plain.path.stat().st_size <= 0.1 * size


def damaged(path, packed, streams="{}"):
    """Return a recording with this content as its checkpoint."""
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
        (b"no archive", "{}"),
        (npz(state=np.zeros(3))[:-9], "{}"),
        (OBJECTS, "{}"),
        (npz(state=np.zeros(100_000)), "{}"),
        (npz(state=np.zeros(3)), "[]"),
        (npz(state=np.zeros(3)), '{"prior": 3}'),
        (npz(state=np.zeros(3)), "{" * 100_000),
    ],
    ids=["no archive", "truncated", "objects", "too large", "a list", "no state", "deep"],
)
def test_a_damaged_checkpoint_is_rejected_with_its_frame(tmp_path, monkeypatch, packed, streams):
    monkeypatch.setattr(partial_run, "_MAX_BYTES", 500_000)
    recording = damaged(tmp_path / "run.rrd", packed, streams)
    with pytest.raises(InputError, match=r"run.rrd: checkpoint of frame 11"):
        past_before(recording, 99)
