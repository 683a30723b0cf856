"""Frames without a person are omitted at the ends and in long gaps only."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.datasets.visible_frames import MAX_BRIDGE_S, visible_frames
from workbench.utils.errors import InputError

RATE_HZ = 10.0


@given(st.sets(st.integers(0, 60), min_size=1))
def test_used_frames_are_detections_and_bridged_gaps(detected):
    used = set(visible_frames("walk", np.array(sorted(detected)), (0, 60), RATE_HZ).tolist())
    for t in range(61):
        before = max((d for d in detected if d <= t), default=-np.inf)
        after = min((d for d in detected if d >= t), default=np.inf)
        bridged = after - before - 1 <= MAX_BRIDGE_S * RATE_HZ
        assert (t in used) == (t in detected or bridged)


def test_the_error_without_a_person_names_the_frames():
    with pytest.raises(InputError, match=r"walk: .*3 to 9"):
        visible_frames("walk", np.array([1, 12]), (3, 9), RATE_HZ)


@pytest.mark.parametrize(("n_missing", "is_bridged"), [(5, True), (6, False)])
def test_gaps_of_half_a_second_are_bridged(n_missing, is_bridged):
    used = visible_frames("walk", np.array([0, 1, 2 + n_missing]), (0, 2 + n_missing), RATE_HZ)
    assert len(used) == (3 + n_missing if is_bridged else 3)
