"""Parts of the body that move independently of each other (paper C, section 7)."""

from collections.abc import Mapping

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import POSE_NAMES
from workbench.errors import InputError
from workbench.priors.mixture import side_by_side
from workbench.priors.state import Prior, propose


class Partwise:
    """The product of priors that each move parameters of their own, such as databases of the upper and lower body:

        p(s_t | s_t−1) = Π_k p_k(s_k,t | s_k,t−1)

    Motions of the parts then combine as they were never recorded together, at the price of losing what couples them.
    A state is the columns of every prior side by side, called "<part>.<column>". Parameters that no prior moves stay
    as they start.

    priors: by the part's name. Raises InputError when there is none or two move the same parameter.
    """

    def __init__(self, priors: Mapping[str, Prior]) -> None:
        if not priors:
            raise InputError("prior: expected a prior for one part of the body or more, found none")
        self.priors = dict(priors)
        moved = [name for prior in priors.values() for name in prior.parameters]
        if twice := sorted({name for name in moved if moved.count(name) > 1}):
            raise InputError(f"prior: parts must not share parameters, found {', '.join(twice)} in two of them")
        self.parameters = tuple(name for name in POSE_NAMES if name in moved)
        self.space = side_by_side(priors)
        self._own = {part: [POSE_NAMES.index(name) for name in prior.parameters] for part, prior in self.priors.items()}

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), every part by its own start."""
        return np.concatenate([prior.start(pose, n, rng) for prior in self.priors.values()], axis=1)

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        moved = [prior.step(self._part(state, part), dt_s, rng) for part, prior in self.priors.items()]
        return np.concatenate(moved, axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the proposals of the parts that have one, and the log weights (N,) that correct for it."""
        moved, log_weights = [], np.zeros(len(state))
        for part, prior in self.priors.items():
            drawn, correction = propose(prior, self._part(state, part), dt_s, rng)
            log_weights = log_weights + correction
            moved.append(drawn)
        return np.concatenate(moved, axis=1), log_weights

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D): of every part its own parameters, the rest as the first part has it."""
        poses = {part: prior.pose(self._part(state, part)) for part, prior in self.priors.items()}
        whole = next(iter(poses.values())).copy()
        for part, own in self._own.items():
            whole[:, own] = poses[part][:, own]
        return whole

    def _part(self, state: FloatArray, part: str) -> FloatArray:
        return np.ascontiguousarray(state[:, self.space.slices[part]])
