"""Base of the studies of walks, and the study of learning the walking prior (paper A, section 6.2, fig. 3)."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.study import Bars, Curves, Figure, StudyResult
from workbench.motion.models.cycle_alignment import motion_period
from workbench.motion.models.training import training_motions
from workbench.motion.models.walking import (
    CHANNEL_NAMES,
    Cycles,
    WalkingModel,
    component_counts,
    learn_walking,
    walking_cycles,
)
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ANGLES = tuple(
    f"{side}_{angle}"
    for side in ("left", "right")
    for angle in ("hip_flexion", "knee_flexion", "shoulder_flexion", "elbow_flexion")
)
"""The joint angles displayed: the left side's four, then the right side's."""

EIGENCURVES = 3
"""Number of eigencurves, as in paper A, fig. 3c."""
MAX_COMPONENTS_SHOWN = 20
N_BINS = 16
log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class WalkStudy:
    """Base of studies of walks. motions, data, cache, subjects: as for `training_motions`."""

    motions: str = "builtin"
    data: str | None = None
    cache: str = "~/.cache/workbench"
    subjects: Sequence[str] | None = None

    def walks(self) -> tuple[Motion, ...]:
        """Return the motions to study, see `training_motions`, and log their number."""
        walks = training_motions(self.motions, data=self.data, cache=self.cache, subjects=self.subjects)
        people = {motion.subject for motion in walks}
        seconds = sum(len(motion) / motion.rate_hz for motion in walks)
        log.info("motions: %d walks (%s) of %d people, %.0f s", len(walks), self.motions, len(people), seconds)
        return walks


def cyclic(motions: Sequence[Motion], summed: bool = False) -> tuple[list[Motion], list[float]]:
    """Return the motions in which a period is found, and their periods in frames; a warning names the others.

    summed : see `snr`. Raises InputError if there are none.
    """
    selected, periods = [], []
    for motion in motions:
        try:
            periods.append(motion_period(motion, motion.poses[:, N_ROOT:], summed))
            selected.append(motion)
        except InputError as error:
            log.warning("%s omitted: %s", motion.name, error)
    if not selected:
        raise InputError(f"study: expected cyclic motions, found no period in any of {len(motions)}")
    return selected, periods


def angle(name: str) -> int:
    """Return the index of a joint angle among the 19."""
    return POSE_NAMES.index(name) - N_ROOT


def title(name: str) -> str:
    """Return a parameter's name with spaces."""
    return name.replace("_", " ")


def degrees(curves: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return curves converted from rad to degrees."""
    return {label: np.degrees(curve) for label, curve in curves.items()}


def closed(curve: FloatArray) -> FloatArray:
    """Return a curve (T,) over phases 0, 1/T, … closed (T + 1,) by its first value at phase 1."""
    return np.append(curve, curve[0])


def phases(n: int) -> FloatArray:
    """Return phases 0, 1/n, …, 1 (n + 1,) of a closed curve."""
    return np.linspace(0.0, 1.0, n + 1)


@dataclass(frozen=True, kw_only=True)
class LearnWalk(WalkStudy):
    """The cycles, their mean, the eigencurves and the variance that these explain.

    variance, n_components, scaling, torso_speed: as for `learn_walking`. n_draws: small training sets, see
    `component_counts`. Metrics: n_cycles; n_components, d; explained, the fraction of the variance that d components
    explain; explained_variance_5, that of five, as in the paper; of the draws drawn_components_median, and
    drawn_components_3_to_7, the fraction whose d is from 3 to 7.
    """

    variance: float = 0.95
    n_components: int | None = None
    scaling: str = "none"
    torso_speed: str = "forward"
    n_draws: int = 0

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Learn and plot; only the draws are random. Raises InputError as `training_motions`, `learn_walking` and
        `component_counts` do."""
        motions = self.walks()
        cycles = walking_cycles(motions, torso_speed=self.torso_speed)
        learn = partial(
            learn_walking, motions, variance=self.variance, scaling=self.scaling, torso_speed=self.torso_speed
        )
        model = learn(n_components=self.n_components)
        max_components = min(model.n_cycles - 1, model.mean.size)
        full = learn(n_components=max_components)
        explained = np.cumsum(full.scales**2) / np.sum(full.scales**2)  # by the first 1, 2, … components
        d = len(model.scales)
        metrics = {
            "n_cycles": float(model.n_cycles),
            "n_components": float(d),
            "explained_variance": model.explained,
            "explained_variance_5": float(explained[min(5, max_components) - 1]),
        }
        heights, edges = np.histogram(cycles.durations_s, bins=N_BINS)
        middles = 0.5 * (edges[1:] + edges[:-1])
        figures: tuple[Figure, ...] = (
            *(_cycles(cycles, model, name) for name in ANGLES),
            *(_eigencurves(model, name) for name in ANGLES),
            _variance_curve(explained, self.variance, d),
            _cycles(cycles, model, "torso_speed"),
            Bars("model/cycles by duration", middles, heights.astype(np.float64), "seconds"),
        )
        if self.n_draws:
            people = {motion.name: motion.subject for motion in motions}
            counts = component_counts(cycles, people, self.n_draws, self.variance, rng)
            metrics["drawn_components_median"] = float(np.median(counts))
            metrics["drawn_components_3_to_7"] = float(((counts >= 3) & (counts <= 7)).mean())
            values, heights = np.unique(counts, return_counts=True)
            figures += (Bars("model/components of draws", values.astype(float), heights.astype(float), "components"),)
        return StudyResult(metrics, figures, _note(model, cycles, explained, self.variance))


def _cycles(cycles: Cycles, model: WalkingModel, name: str) -> Curves:
    """Return a channel's mean cycle, and every cycle by its number and clip."""
    channel, x = CHANNEL_NAMES.index(name), phases(len(model.mean))
    numbered = enumerate(zip(cycles.sources, cycles.curves, strict=True), start=1)
    each = {f"{k}, {source}": closed(curve[:, channel]) for k, (source, curve) in numbered}
    mean = {"mean": closed(model.mean[:, channel])}
    if name == "torso_speed":
        return Curves("model/torso speed", x, mean, "cycle", "metres per second", faint=each)
    return Curves(f"cycles/{title(name)}", x, degrees(mean), "cycle", "degrees", faint=degrees(each))


def _eigencurves(model: WalkingModel, name: str) -> Curves:
    """Return mean + 2 λ_k of component k, faint: mean − 2 λ_k. Paper A plots λ_k times the component alone."""
    channel = CHANNEL_NAMES.index(name)
    mean = model.mean[:, channel]
    curves, mirrored = {"mean": closed(mean)}, {}
    for k in range(min(EIGENCURVES, len(model.scales))):
        swing = 2.0 * model.scales[k] * model.components[k, :, channel]
        curves[f"+2λ{k + 1}"] = closed(mean + swing)
        mirrored[f"−2λ{k + 1}"] = closed(mean - swing)
    x, faint = phases(len(mean)), degrees(mirrored)
    return Curves(f"eigencurves/{title(name)}", x, degrees(curves), "cycle", "degrees", faint=faint)


def _variance_curve(explained: FloatArray, variance: float, d: int) -> Curves:
    shown = explained[:MAX_COMPONENTS_SHOWN]
    count = np.arange(1.0, len(shown) + 1.0)
    curves = {"explained": shown, f"{variance:g}": np.full(len(shown), variance)}
    marks = {"d =": float(d)} if d <= len(shown) else {}
    return Curves("model/explained variance", count, curves, "components", "part of the variance", marks=marks)


def _note(model: WalkingModel, cycles: Cycles, explained: FloatArray, variance: float) -> str:
    needed = int(np.searchsorted(explained, variance, side="right")) + 1
    return (
        f"**Paper A, fig. 3.** {model.n_cycles} walking cycles of {len(set(cycles.sources))} clips, divided at gait "
        "events: every cycle (thin) and their mean; the eigencurves, that is the mean plus (thin: minus) twice the "
        "standard deviation λ of each of the first components; and the variance that the components explain. More "
        f"than {variance:g} of it requires {needed} components (the paper: 5, from 13 cycles of 4 people); the model "
        f"has {len(model.scales)}, which explain {model.explained:.3f}."
    )
