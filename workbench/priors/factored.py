"""Parts of the body that move independently of each other (paper C, section 7)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DENSITY, Traits, needs_of_all, offers_of_all
from workbench.core.keys import keeps_keys
from workbench.core.prior import Density, Powers, Prior, propose
from workbench.core.side_information import REST
from workbench.priors.mixture import common_smoothness, side_by_side
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


@keeps_keys
class Partwise:
    """The product of priors that each move parameters of their own, such as databases of the upper and lower body:

        p(s_t | s_t−1) = Π_k p_k(s_k,t | s_k,t−1)

    Motions of the parts then combine as they were never recorded together, at the price of losing what couples them.
    A state is the columns of every prior side by side, called "<part>.<column>". Parameters that none moves stay.

    priors: by the part's name. Raises InputError when there is none or two move the same parameter.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density where all parts have one."""
        parts = keys["priors"]
        needs = needs_of_all(parts)
        return Traits(offers_of_all(parts) & {DENSITY}, needs | {"given": needs.get("given", frozenset()) - {REST}})

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

    @property
    def powers(self) -> Powers:
        """The product of the parts' densities, where all have one; their penalty, where it is one; their examples."""
        parts = {name: prior.powers.density for name, prior in self.priors.items()}
        densities = {name: density for name, density in parts.items() if density is not None}
        density = PartwiseDensity(self, densities) if len(densities) == len(parts) else None
        examples = self._examples if any(prior.powers.examples for prior in self.priors.values()) else None
        return Powers(density=density, smoothness=common_smoothness(self.priors), examples=examples)

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), every part by its own start."""
        return np.concatenate([prior.start(pose, n, rng) for prior in self.priors.values()], axis=1)

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return np.concatenate([p.step(self.part(state, part), dt_s, rng) for part, p in self.priors.items()], axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the proposals of the parts that have one, and the log weights (N,) that correct for it."""
        moved, log_weights = [], np.zeros(len(state))
        for part, prior in self.priors.items():
            drawn, correction = propose(prior, self.part(state, part), dt_s, rng)
            log_weights = log_weights + correction
            moved.append(drawn)
        return np.concatenate(moved, axis=1), log_weights

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D): of every part its own parameters, the rest as the first part has it."""
        poses = {part: prior.pose(self.part(state, part)) for part, prior in self.priors.items()}
        whole = next(iter(poses.values())).copy()
        for part, own in self._own.items():
            whole[:, own] = poses[part][:, own]
        return whole

    def _examples(self) -> FloatArray:
        """Poses (n, P) whose parts are those of the parts' examples, put together as they come, or else zero."""
        given = {part: prior.powers.examples for part, prior in self.priors.items()}
        parts = {part: examples() for part, examples in given.items() if examples is not None}
        n = max(map(len, parts.values()))
        poses = np.zeros((n, len(POSE_NAMES)))
        for part, examples in parts.items():
            poses[:, self._own[part]] = examples[np.arange(n) * len(examples) // n][:, self._own[part]]
        return poses

    def part(self, state: FloatArray, part: str) -> FloatArray:
        """Take the columns of states (..., D) that belong to a part."""
        return np.ascontiguousarray(state[..., self.space.slices[part]])


@dataclass(frozen=True, eq=False)
class PartwiseDensity:
    """The product of the parts' densities."""

    prior: Partwise
    parts: Mapping[str, Density]

    @property
    def free(self) -> IntArray:
        """The parts' free columns."""
        slices = self.prior.space.slices
        return np.concatenate([slices[part].start + density.free for part, density in self.parts.items()])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        moved = [density.mean(self.prior.part(state, part), dt_s) for part, density in self.parts.items()]
        return np.concatenate(moved, axis=1)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast."""
        part = self.prior.part
        terms = (p.log_transition(part(previous, name), part(state, name), dt_s) for name, p in self.parts.items())
        return sum(terms, start=np.zeros(()))

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """The states (N, D) with every part's columns that follow from others drawn given those."""
        part = self.prior.part
        whole = (p.complete(part(previous, name), part(state, name), dt_s, rng) for name, p in self.parts.items())
        return np.concatenate(list(whole), axis=1)
