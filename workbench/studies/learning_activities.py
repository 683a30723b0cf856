"""The study of learning a joint motion model of walking and running (paper D, section 3.2, fig. 1b, 1c and 4)."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.study import Curves, Figure, Scatter, StudyResult
from workbench.motion.formats import names
from workbench.motion.models import activities
from workbench.motion.models.activities import ActivityModel, learn_activities, min_components
from workbench.motion.models.activity_cycles import ActivityCycles, activity_cycles
from workbench.motion.models.training import database_motions
from workbench.studies.learning import closed, degrees, phases, title
from workbench.utils.arrays import FloatArray

PARTS_SHOWN = {"whole body": "body", "legs": "lower_body"}
ANGLES = ("left_hip_flexion", "left_knee_flexion", "left_shoulder_flexion", "left_elbow_flexion")
EIGENVECTORS = 5
"""Number of eigenvectors, as in paper D, and of components of accuracies unless stated otherwise."""
MAX_COMPONENTS_SHOWN = 20
VARIANCE = 0.9
"""The paper's σ, eq. 7."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LearnWalkRun:
    """The examples' first two coefficients by activity, the variance explained, mean cycles and eigenvectors.

    motions, data, cache, exclude, activities: as for `database_motions`. max_per_clip: as for `activity_cycles`.

    Metrics, of the whole body and with suffix _legs of the hips and knees alone: n_components_90, the fewest that
    explain more than 0.9 of the variance; activity_accuracy, the fraction of the examples whose activity is classified
    correctly from five components by a model without their clip, and activity_accuracy_2 from two; unseen_style_deg,
    the root mean square error of an angle reconstructed by five components of a model without its style (Bandai's; in
    other data its subject). Further: n_examples, n_clips, and cycle_rate_hz_<activity>, the mean phase speed.
    """

    motions: str = "builtin"
    data: str | None = None
    cache: str = "~/.cache/workbench"
    exclude: Sequence[str] = ()
    activities: Sequence[str] = ("walk", "run")
    max_per_clip: int = 4

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Learn and plot; not random. Raises InputError as `database_motions` and the learning functions do."""
        motions = database_motions(
            self.motions, data=self.data, cache=self.cache, exclude=self.exclude, activities=self.activities
        )
        cycles = activity_cycles(motions, max_per_clip=self.max_per_clip)
        log.info("motions: %d cycles (%s) of %d clips", len(cycles), self.motions, len(set(cycles.sources)))
        parts = PARTS_SHOWN.items()
        models = {name: learn_activities(cycles, angles=[part], n_components=EIGENVECTORS) for name, part in parts}
        metrics = _metrics(cycles, models)
        body = models["whole body"]
        figures: tuple[Figure, ...] = (
            *(_first_two(label, model) for label, model in models.items()),
            _variance_curves(models),
            *(_cycles(cycles, name) for name in ANGLES),
            *(figure for name in ANGLES[:2] for figure in _eigenvectors(body, name)),
        )
        return StudyResult(metrics, figures, _note(metrics))


def style(source: str) -> str:
    """Return the style in a Bandai clip's name, otherwise the subject: the name up to the clip's number or path."""
    bandai = names.style(source)
    return bandai.removeprefix("bandai-") if bandai else source.rpartition("_")[0] or source


def _metrics(cycles: ActivityCycles, models: dict[str, ActivityModel]) -> dict[str, float]:
    metrics = {"n_examples": float(len(cycles)), "n_clips": float(len(set(cycles.sources)))}
    styles = [style(source) for source in cycles.sources]
    for suffix, (label, part) in zip(("", "_legs"), PARTS_SHOWN.items(), strict=True):
        selected = cycles.of_angles([part])
        metrics[f"n_components_90{suffix}"] = float(min_components(models[label].explained, VARIANCE))
        metrics[f"activity_accuracy{suffix}"] = activities.held_out_accuracy(selected, cycles.sources, EIGENVECTORS)
        metrics[f"activity_accuracy_2{suffix}"] = activities.held_out_accuracy(selected, cycles.sources, 2)
        metrics[f"unseen_style_deg{suffix}"] = activities.held_out_error_deg(selected, styles, EIGENVECTORS)
    rates = activities.mean_rates_hz(models["whole body"])
    return metrics | {f"cycle_rate_hz_{activity}": rate for activity, rate in rates.items()}


def _first_two(label: str, model: ActivityModel) -> Scatter:
    labels = np.array(model.activities)
    points = {str(name): model.scores[labels == name, :2] for name in np.unique(labels)[::-1]}
    return Scatter(f"model/first two components, {label}", points, "α₁ in standard deviations", "α₂")


def _variance_curves(models: dict[str, ActivityModel]) -> Curves:
    n = min(MAX_COMPONENTS_SHOWN, *(len(model.explained) for model in models.values()))
    curves = {label: model.explained[:n] for label, model in models.items()} | {"0.9": np.full(n, VARIANCE)}
    return Curves("model/explained variance", np.arange(1.0, n + 1.0), curves, "components", "part of the variance")


def _cycles(cycles: ActivityCycles, name: str) -> Curves:
    """Return an angle's mean cycle of every activity, and of every activity by style or subject."""
    curves = cycles.curves[:, :, cycles.angles.index(name)]
    labels = np.array(cycles.activities)
    each = np.array([f"{activity}, {style(source)}" for activity, source in zip(labels, cycles.sources, strict=True)])
    means, faint = _means(curves, labels), _means(curves, each)
    x = phases(curves.shape[1])
    return Curves(f"mean cycles/{title(name)}", x, degrees(means), "cycle", "degrees", faint=degrees(faint))


def _means(curves: FloatArray, labels: NDArray[np.str_]) -> dict[str, FloatArray]:
    """Return the mean curve by label, the last label first."""
    return {str(label): closed(curves[labels == label].mean(axis=0)) for label in np.unique(labels)[::-1]}


def _eigenvectors(model: ActivityModel, name: str) -> tuple[Curves, Curves]:
    """Return one standard deviation of every component of an angle, and its derivative by the phase (D, fig. 4)."""
    column = model.angles.index(name)
    x = phases(4 * len(model.mean))
    moved, _ = model.jacobian_at(np.zeros(len(model.scales)), x)
    units = np.eye(len(model.scales))
    rates = np.stack([model.jacobian_at(unit, x)[1] for unit in units]) - model.jacobian_at(0.0 * units[0], x)[1]
    curves = {f"σ{k + 1} Θ{k + 1}": moved[:, column, k] for k in range(len(units))}
    derivatives = {label: rates[k, :, column] for k, label in enumerate(curves)}
    return (
        Curves(f"eigenvectors/{title(name)}", x, degrees(curves), "cycle", "degrees"),
        Curves(f"eigenvectors/{title(name)}, derivative", x, degrees(derivatives), "cycle", "degrees a cycle"),
    )


def _note(metrics: dict[str, float]) -> str:
    return (
        f"**Paper D, fig. 1b, 1c and 4.** {metrics['n_examples']:.0f} cycles of {metrics['n_clips']:.0f} clips, one "
        "model for all activities: the examples' first two coefficients, the variance explained (components for 0.9 "
        f"of it: {metrics['n_components_90']:.0f}, of the legs alone {metrics['n_components_90_legs']:.0f}; the paper: "
        "5), mean cycles by activity (thin: by style or subject), the components over the phase and their "
        f"derivatives. A model without the clip classifies {100 * metrics['activity_accuracy_2']:.1f} % of the "
        f"examples correctly from two components of the whole body, {100 * metrics['activity_accuracy_2_legs']:.1f} % "
        f"from two of the legs; from five, {100 * metrics['activity_accuracy']:.1f} % and "
        f"{100 * metrics['activity_accuracy_legs']:.1f} %. Five components reconstruct an angle of an unseen style "
        f"with an error of {metrics['unseen_style_deg']:.1f}°."
    )
