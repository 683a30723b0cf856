"""The states of frames and joints that a recording's verdict has."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict.joint_states import JOINT_GROUPS, TRACKED
from workbench.recording.read.chunks import cells
from workbench.recording.write.outcome import STATE
from workbench.utils.arrays import BoolArray
from workbench.utils.errors import InputError
from workbench.utils.finding import DOUBTFUL

SHOWN = {TRACKED: (TRACKED,), DOUBTFUL: (TRACKED, DOUBTFUL)}
"""States that are at least as good as the first one."""


def lane(path: Path, name: str, frames: Sequence[int]) -> list[str]:
    """Return the states of a lane in ascending frames, "" before its first state and without such a lane."""
    entity = f"{STATE}/{name}"
    changes = cells(path, [f"/{entity}"]).get(entity, {}).get("StateChange:state", {})
    states, state = list[str](), ""
    for frame in frames:
        state = changes[frame].as_py()[0] if frame in changes else state
        states.append(state)
    return states


def joints_below(path: Path, frames: Sequence[int], min_state: str, names: Sequence[str] = JOINT_NAMES) -> BoolArray:
    """Return which joints (F, J) of the `names`, a person's with feet or without, belong to a part of the body with a
    state below `min_state`, "tracked" or "doubtful", in ascending frames. Feet have the state of their ankle.

    Raises InputError for another state, and for a recording without states of joints.
    """
    if min_state not in SHOWN:
        raise InputError(f"--min-state: expected {' or '.join(SHOWN)}, found {min_state!r}")
    below = np.zeros((len(frames), len(JOINT_NAMES)), bool)
    for group, joints in JOINT_GROUPS.items():
        states = lane(path, group, frames)
        if not any(states):
            raise InputError(f"{path}: no states of joints, which --min-state needs; they require keypoints or a truth")
        below[:, [JOINT_NAMES.index(name) for name in joints]] = ~np.isin(states, SHOWN[min_state])[:, None]
    of_feet = [JOINT_NAMES.index(f"{name.partition('_')[0]}_ankle") for name in names[len(JOINT_NAMES) :]]
    return np.concatenate([below, below[:, of_feet]], axis=1)
