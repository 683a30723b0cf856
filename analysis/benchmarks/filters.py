"""The particle filter's own time per step, and that of the package `particles` with our prior and likelihood in it.

It is the time of a step without the prior and the likelihood: resampling before every frame, copying particles (state
and pose) from their ancestors, normalising the weights, the effective sample size and the expected pose. The time of
the prior, the likelihood and their adapters is measured inside each run and subtracted. All in processor seconds,
because the times are short and other load would show.
"""

import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np
from tqdm import tqdm

from analysis.benchmarks.figure import Figure, not_measured
from workbench.body.camera import plain_camera
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.core.frame import Frame, View
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.image_motion import ImageMotion
from workbench.priors.from_motions import walking
from workbench.utils.arrays import FloatArray

N_PARTICLES, N_FRAMES, REPEATS = 10_000, 6, 10
RATE_HZ = 30.0


@dataclass
class Clock:
    """Seconds spent in the plugged-in objects."""

    seconds: float = 0.0

    @contextmanager
    def running(self) -> Any:
        start = time.thread_time()
        yield
        self.seconds += time.thread_time() - start


class Timed:
    """Proxy of another object; the seconds of its methods, and of those of the frame likelihoods it returns, go to a
    clock."""

    def __init__(self, inner: object, clock: Clock) -> None:
        self._inner, self._clock = inner, clock

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._inner, name)
        if not callable(value):
            return value

        def timed(*arguments: object) -> object:
            with self._clock.running():
                result = value(*arguments)
            return Timed(result, self._clock) if name in ("prepare", "update") else result

        return timed


@dataclass
class Plugged:
    """Adapter of our prior and likelihood to the other package: particles (N, D + 25) are the state and its pose."""

    prior: Any
    likelihood: ImageMotion
    frames: Sequence[Frame]
    start: FloatArray
    clock: Clock = field(default_factory=Clock)

    def first(self, rng: np.random.Generator) -> FloatArray:
        with self.clock.running():
            return self._with_poses(self.prior.sample_initial(self.start, N_PARTICLES, rng))

    def move(self, particles: FloatArray, rng: np.random.Generator) -> FloatArray:
        with self.clock.running():
            state = np.ascontiguousarray(particles[:, : len(self.prior.space)])
            return self._with_poses(self.prior.sample_transition(state, 1.0 / RATE_HZ, rng))

    def log_prob(self, t: int, before: FloatArray, now: FloatArray) -> FloatArray:
        with self.clock.running():
            frame_likelihood = self.likelihood.prepare(self.frames[t - 1], self.frames[t])
            return frame_likelihood.evaluate(self.poses(before), self.poses(now)).log_prob

    def poses(self, particles: FloatArray) -> FloatArray:
        return particles[:, len(self.prior.space) :]

    def _with_poses(self, state: FloatArray) -> FloatArray:
        return np.concatenate([state, self.prior.pose(state)], axis=1)


def figures() -> list[Figure]:
    """Measure our overhead over that of `particles`."""
    what = ("filter_overhead_vs_peers", "× its time", 0.1, "lower")
    if find_spec("particles") is None:
        return [not_measured(*what, 'particles is not installed: pip install -e ".[bench]"')]
    plugged, overheads = _plugged(), np.empty((REPEATS + 1, 2))
    for repeat in tqdm(overheads, disable=None, leave=False):
        for column, loop in enumerate((_ours, _theirs)):
            plugged.clock.seconds = 0.0
            start = time.thread_time()
            loop(plugged)
            repeat[column] = (time.thread_time() - start - plugged.clock.seconds) / (N_FRAMES - 1)
    ours, theirs = overheads[1:].min(axis=0)
    beyond = f"{N_PARTICLES} particles, {1e3 * ours:.2f} ms a step beyond prior and likelihood"
    return [Figure(what[0], ours / theirs, *what[1:], f"particles: {1e3 * theirs:.2f} ms; {beyond}")]


def _plugged() -> Plugged:
    """Return a walker in front of images of noise."""
    camera, rng = plain_camera(160, 120, 155.0, (0.0, -4.0, 1.0), (0.0, 0.0, 0.95)), np.random.default_rng(0)
    images = rng.integers(0, 256, size=(N_FRAMES, 120, 160), dtype=np.uint8)
    frames = [Frame(i, i / RATE_HZ, (View(camera, image),)) for i, image in enumerate(images)]
    start = np.zeros(25)
    start[2] = 0.95
    return Plugged(walking(), ImageMotion(person(from_height(1.75)), n_samples=10), frames, start)


def _ours(plugged: Plugged) -> None:
    prior, likelihood = Timed(plugged.prior, plugged.clock), Timed(plugged.likelihood, plugged.clock)
    streams = dict(zip(("start", "resampling", "prior"), np.random.default_rng(0).spawn(3), strict=True))
    for _ in ParticleFilter(prior, likelihood, n_particles=N_PARTICLES).run(plugged.frames, plugged.start, streams):
        pass


def _theirs(plugged: Plugged) -> None:
    import particles
    from particles.collectors import Moments

    rng = np.random.default_rng(0)

    class Model(particles.FeynmanKac):  # type: ignore[misc]
        def M0(self, N: int) -> FloatArray:  # noqa: N802, N803 - the package's names
            return plugged.first(rng)

        def M(self, t: int, xp: FloatArray) -> FloatArray:  # noqa: N802
            return plugged.move(xp, rng)

        def logG(self, t: int, xp: FloatArray | None, x: FloatArray) -> FloatArray:  # noqa: N802
            return np.zeros(N_PARTICLES) if xp is None else plugged.log_prob(t, xp, x)

        def default_moments(self, W: FloatArray, X: FloatArray) -> FloatArray:  # noqa: N803
            mean: FloatArray = np.average(plugged.poses(X), weights=W, axis=0)
            return mean

    particles.SMC(fk=Model(T=N_FRAMES), N=N_PARTICLES, ESSrmin=1.0, collect=[Moments()]).run()
