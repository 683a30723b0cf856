"""Frames without images: what the dataset hands out, and what it refuses."""

import numpy as np
import pytest

from workbench.datasets.blank import Blank
from workbench.motion.sources import find_motion


def test_frames_are_empty_and_evenly_spaced():
    blank = Blank(n_frames=5, rate_hz=20.0)
    frames = list(blank.frames())
    assert blank.known.n_frames == len(frames) == 5
    assert [frame.index for frame in frames] == [0, 1, 2, 3, 4]
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
    assert all(frame.views == () and frame.truth is None for frame in frames)
    assert [frame.index for frame in blank.frames()] == [0, 1, 2, 3, 4]  # more than once


def test_the_start_is_the_motions_and_the_lead_in_ends_there():
    motion = find_motion("builtin", data=None, rate_hz=30.0)
    known = Blank(first_frame=7).known
    assert (known.start_pose == motion.poses[7]).all()
    assert (known.lead_in == motion.poses[:8]).all()
    assert known.lead_in_activity == motion.activity
    assert known.rate_hz == 30.0
    assert np.array_equal(known.shape.as_dict(), motion.shape.as_dict())
    assert motion.name in known.name
