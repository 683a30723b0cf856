"""The particle filter's own time a step, beside that of other packages' filters with our prior and likelihood in them.

What counts is what a step takes beyond the prior and the likelihood: resampling before every frame, moving particles
(state and pose) to where their ancestors were, normalising the weights, the effective sample size and the expected
pose. What the prior and the likelihood take, and what it takes to plug them in, is measured inside each run and left
out. All in seconds of the processor: the time is short, and what other programs do would show. `particles` has a class
to derive from, Stone Soup a predictor, an updater and a resampler; filterpy a resampler only, around which its
documentation writes the loop.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta
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
BAR = 0.1


@dataclass
class Clock:
    """Seconds spent in what is plugged in."""

    seconds: float = 0.0

    @contextmanager
    def running(self) -> Any:
        start = time.thread_time()
        yield
        self.seconds += time.thread_time() - start


class Timed:
    """Another object; the seconds of its methods, and of those of looks and likelihoods it gives, go to a clock."""

    def __init__(self, inner: object, clock: Clock) -> None:
        self._inner, self._clock = inner, clock

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._inner, name)
        if not callable(value):
            return value

        def timed(*arguments: object) -> object:
            with self._clock.running():
                result = value(*arguments)
            return Timed(result, self._clock) if name in ("look", "remember") else result

        return timed


@dataclass
class Plugged:
    """Our prior and likelihood as other packages want them: particles (N, D + 25) are the state and its pose."""

    prior: Any
    likelihood: ImageMotion
    frames: Sequence[Frame]
    start: FloatArray
    clock: Clock = field(default_factory=Clock)

    def first(self, rng: np.random.Generator) -> FloatArray:
        with self.clock.running():
            return self._with_poses(self.prior.start(self.start, N_PARTICLES, rng))

    def move(self, particles: FloatArray, rng: np.random.Generator) -> FloatArray:
        with self.clock.running():
            state = np.ascontiguousarray(particles[:, : len(self.prior.space)])
            return self._with_poses(self.prior.step(state, 1.0 / RATE_HZ, rng))

    def log_prob(self, t: int, before: FloatArray, now: FloatArray) -> FloatArray:
        with self.clock.running():
            look = self.likelihood.look(self.frames[t - 1], self.frames[t])
            return look.evaluate(self.poses(before), self.poses(now)).log_prob

    def poses(self, particles: FloatArray) -> FloatArray:
        return particles[:, len(self.prior.space) :]

    def _with_poses(self, state: FloatArray) -> FloatArray:
        return np.concatenate([state, self.prior.pose(state)], axis=1)


def figures() -> list[Figure]:
    """Our overhead over each peer's, and over that of the fastest."""
    plugged = _plugged()
    loops = {"particles": _with_particles, "stonesoup": _with_stone_soup, "filterpy": _with_filterpy}
    installed = {name: loop for name, loop in loops.items() if find_spec(name) is not None}
    overheads = _fastest_overheads([_ours, *installed.values()], plugged)
    ours, theirs = overheads[0], dict(zip(installed, overheads[1:], strict=True))
    what = f"{N_PARTICLES} particles, ours {1e3 * ours:.2f} ms a step beyond prior and likelihood"
    each = [
        Figure(f"filter_overhead_vs_{name}", ours / theirs[name], "× its time", BAR, "lower",
               f"{name}: {1e3 * theirs[name]:.2f} ms; {what}")
        if name in theirs
        else not_measured(f"filter_overhead_vs_{name}", "× its time", BAR, "lower", _missing(name))
        for name in loops
    ]  # fmt: skip
    absent = [name for name in loops if name not in theirs]
    whole = ("filter_overhead_vs_peers", "× its time", BAR, "lower")
    if absent:
        return [not_measured(*whole, ", ".join(map(_missing, absent))), *each]
    fastest = min(theirs, key=lambda name: theirs[name])
    return [Figure(whole[0], ours / theirs[fastest], *whole[1:], f"the fastest, {fastest}; {what}"), *each]


def _missing(name: str) -> str:
    return f'{name} is not installed: pip install -e ".[bench]"'


def _fastest_overheads(loops: Sequence[Callable[[Plugged], None]], plugged: Plugged) -> list[float]:
    """Seconds a step of each loop beyond what is plugged in: the fastest of REPEATS runs, which take turns."""
    overheads = np.empty((REPEATS + 1, len(loops)))
    for repeat in tqdm(overheads, disable=None, leave=False):
        for column, loop in enumerate(loops):
            plugged.clock.seconds = 0.0
            start = time.thread_time()
            loop(plugged)
            repeat[column] = (time.thread_time() - start - plugged.clock.seconds) / (N_FRAMES - 1)
    return [float(seconds) for seconds in overheads[1:].min(axis=0)]


def _plugged() -> Plugged:
    """A walker before noise, which tells the particles apart as well as anything."""
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


def _with_particles(plugged: Plugged) -> None:
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


def _with_stone_soup(plugged: Plugged) -> None:
    from stonesoup.models.measurement import MeasurementModel
    from stonesoup.models.transition import TransitionModel
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    rng = np.random.default_rng(0)

    class Transition(TransitionModel):  # type: ignore[misc]
        ndim_state = ndim = len(plugged.prior.space) + len(plugged.start)

        def function(self, state: Any, noise: bool = False, **_: object) -> Any:
            with plugged.clock.running():
                before = np.ascontiguousarray(np.asarray(state.state_vector).T)
            moved = plugged.move(before, rng)
            with plugged.clock.running():
                return StateVectors(moved.T)

        def rvs(self, num_samples: int = 1, **_: object) -> Any:
            raise NotImplementedError

        pdf = logpdf = rvs

    class Measurement(MeasurementModel):  # type: ignore[misc]
        ndim_state = Transition.ndim_state
        ndim_meas = 1
        mapping = (0,)

        def logpdf(self, state1: Any, state2: Any, **_: object) -> FloatArray:
            with plugged.clock.running():
                before, now = (np.asarray(s.state_vector).T for s in (state2.hypothesis.prediction.parent, state2))
            return plugged.log_prob(int(state1.state_vector[0, 0]), before, now)

        def function(self, state: Any, **_: object) -> Any:
            raise NotImplementedError

        pdf = rvs = function

    predictor = ParticlePredictor(Transition())
    updater = ParticleUpdater(Measurement(), resampler=SystematicResampler())
    began = datetime(2000, 1, 1)
    even = np.full(N_PARTICLES, -np.log(N_PARTICLES))
    posterior = ParticleState(StateVectors(plugged.first(rng).T), log_weight=even, timestamp=began)
    for t in range(1, N_FRAMES):
        now = began + timedelta(seconds=t / RATE_HZ)
        prediction = predictor.predict(posterior, timestamp=now)
        posterior = updater.update(SingleHypothesis(prediction, Detection(np.array([[t]]), timestamp=now)))
        assert len(posterior.mean) == Transition.ndim_state


def _with_filterpy(plugged: Plugged) -> None:
    from filterpy.monte_carlo import systematic_resample

    rng = np.random.default_rng(0)
    particles, weights = plugged.first(rng), np.full(N_PARTICLES, 1.0 / N_PARTICLES)
    for t in range(1, N_FRAMES):
        before = particles[systematic_resample(weights)]
        particles = plugged.move(before, rng)
        log_prob = plugged.log_prob(t, before, particles)
        weights = np.exp(log_prob - log_prob.max())
        weights /= weights.sum()
        assert 1.0 / np.sum(np.square(weights)) >= 1.0
        np.average(plugged.poses(particles), weights=weights, axis=0)
