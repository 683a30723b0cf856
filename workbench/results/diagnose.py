"""Causes of a lost track: repetitions of a run with one change and several seeds each."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from omegaconf import OmegaConf
from tqdm import tqdm

from workbench.datasets.rendering.perturbations import perturbation_sizes
from workbench.evaluation.errors.track_loss import track_events
from workbench.evaluation.metrics import HEADLINE_ERRORS
from workbench.experiment.config.options import allow_packages, packages
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.repeat import repeated_config
from workbench.experiment.run import execute
from workbench.recording.read.chunks import cells
from workbench.recording.read.reader import Run, read
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.errors import InputError
from workbench.utils.processes import pool

BEFORE, AFTER = 15, 10
"""Frames before and after a loss in which a repetition's errors are compared; repetitions end after the latter."""
_FIRST_SEED = 1000
_PRIORS = ("smooth", "ar_offsets")  # without activity, and a walk with offsets of every angle
_TRACKING = "state/tracking"


@dataclass(frozen=True)
class Change:
    """A change of the configuration. overrides: key=value."""

    name: str
    overrides: tuple[str, ...] = ()


SAME = Change("only another seed")


@dataclass(frozen=True)
class Outcome:
    """Outcome of n repetitions with a change.

    n_tracked: repetitions that keep the track. error: their mean error, mm or px, or NaN.
    """

    change: Change
    n_tracked: int
    n: int
    error: float


def lost_frames(run: Run) -> list[int]:
    """Return the frames where a run loses the track, by its verdict or else its ground truth; InputError without
    both."""
    states = cells(run.path, [f"/{_TRACKING}"]).get(_TRACKING, {}).get("StateChange:state", {})
    if not states and "forearm_width_px" in run.metrics:
        (frames, errors), (_, widths) = run.metric("mpjpe_px"), run.metric("forearm_width_px")
        events = track_events(errors.tolist(), widths.tolist())
        return [int(frames[event.frame]) for event in events if event.kind == "lost"]
    if not states and "mpjpe_px" not in run.metrics:
        raise InputError(f"{run.path}: expected ground truth, keypoints or annotated frames, found none")
    return sorted(frame for frame, state in states.items() if "lost" in state.as_py())


def changes_of(config: Mapping[str, Any]) -> Iterator[Change]:
    """Yield the possible changes of a resolved configuration."""
    place, inner = "inference", config["inference"]
    while not inner.get("n_particles") and inner.get("filter"):
        place, inner = f"{place}.filter", inner["filter"]
    if n := inner.get("n_particles"):
        yield Change("4 times the particles", (f"{place}.n_particles={4 * n}",))
    cues = [name for name, weight in ((config["likelihood"] or {}).get("weights") or {}).items() if weight]
    for name in cues if len(cues) > 1 else ():
        yield Change(f"without {name}", (f"likelihood.weights.{name}=0.0",))
    for name in _PRIORS:
        if not str((config["prior"] or {}).get("_target_")).lower().endswith(name):
            yield Change(f"prior={name}", (f"prior={name}",))
    if "perturbations" in config["dataset"]:
        yield from _changes_of_scene(config["body"], config["dataset"])


def _changes_of_scene(body: Mapping[str, Any], dataset: Mapping[str, Any]) -> Iterator[Change]:
    if dataset.get("occluder"):
        yield Change("without the occluder", ("dataset.occluder=false",))
    of_dataset = str(body["_target_"]).endswith("person.of_dataset")
    if not of_dataset or body.get("scale", 1.0) != 1.0:
        yield Change("the true body", ("body.scale=1.0" if of_dataset else "body=dataset",))
    perturbed = perturbation_sizes(bool(dataset.get("perturb", True)), dataset["perturbations"])
    for name in (each for each, size in perturbed.items() if size):
        words = ",".join(f"{key}:{value}" for key, value in (perturbed | {name: 0.0}).items())
        yield Change(f"without perturbation {name}", (f"dataset.perturbations={{{words}}}",))


def diagnose(
    run: Run, frame: int, overrides: Sequence[str], n_seeds: int, jobs: int, folder: Path
) -> tuple[list[Outcome], list[str]]:
    """Repeat a run up to a frame with every change.

    Parameters
    ----------
    run : with a lost track.
    frame : of the loss. Repetitions end AFTER frames later.
    overrides : key=value, of all repetitions.
    n_seeds, jobs : seeds of every change, and processes.
    folder : of the repetitions.

    Returns
    -------
    outcomes, refused : outcomes, the best first, and a message for each impossible change.
    """
    plain: Any = OmegaConf.to_container(repeated_config(run, overrides)[0], resolve=True)
    changes = [SAME, *changes_of(plain)]
    repeat = partial(_repeat, run.path, frame, overrides, folder)
    tasks = [(change, _FIRST_SEED + k) for change in changes for k in range(n_seeds)]
    with pool(jobs, _prepare, packages()[1:]) as executor:
        results = list(tqdm(executor.map(repeat, tasks), total=len(tasks), unit="run", disable=None))
    outcomes, refused = list[Outcome](), list[str]()
    for place, change in enumerate(changes):
        first, *others = results[place * n_seeds : (place + 1) * n_seeds]
        if isinstance(first, InputError):
            refused.append(f"{change.name}: {first}")
        else:
            tracked, errors = np.array([first, *others]).T
            outcomes.append(Outcome(change, int(tracked.sum()), n_seeds, float(errors.mean())))
    return sorted(outcomes, key=lambda each: (-each.n_tracked, np.nan_to_num(each.error, nan=np.inf))), refused


def _prepare(named: Sequence[str]) -> None:
    allow_packages(named)
    prepare_hydra()


class _Until:
    """Condition that ends a run after n frames or at a loss."""

    def __init__(self, n: int) -> None:
        self._left = n - WINDOW_FRAMES  # `execute` evaluates it first after WINDOW_FRAMES

    def __call__(self, numbers: Mapping[str, float]) -> bool:
        self._left -= 1
        return self._left <= 0 or numbers.get("n_track_losses", 0.0) > 0.0

    def __str__(self) -> str:
        return "the track is lost, or all frames are repeated"


def _repeat(
    path: Path, frame: int, overrides: Sequence[str], folder: Path, task: tuple[Change, int]
) -> tuple[bool, float] | InputError:
    """Return whether a repetition tracks, and its error; or why it is impossible."""
    run, (change, seed) = read(path), task
    place = folder / change.name.replace(" ", "_") / str(seed)
    try:
        config, command = repeated_config(run, [*overrides, *change.overrides, f"seed={seed}", "n_threads=1"])
        until = _Until(frame + AFTER + 1 - int(run.poses[0][0]))
        summary = execute(config, command.choices["experiment"], place, True, command, until)
    except InputError as error:
        return error
    errors = [summary.metrics[name] for name in HEADLINE_ERRORS if name in summary.metrics]
    states = summary.verdict.states if summary.verdict is not None else ()
    tracked = "lost" not in states if any(states) else _is_near(run, frame, summary.metrics)
    return tracked, errors[0] if errors else np.nan


def _is_near(run: Run, frame: int, metrics: Mapping[str, float]) -> bool:
    """Return whether the mean error in annotated frames near the loss is less than half of the run's."""
    frames, errors = run.metric("mpjpe_px")
    near = (frames > frame - BEFORE) & (frames <= frame + AFTER)
    return bool(near.any() and metrics.get("mpjpe_px", np.inf) < 0.5 * errors[near].mean())


def conclusion(outcomes: Sequence[Outcome]) -> str:
    """Return the most likely cause: the best change and its advantage over another seed; outcomes: see `diagnose`."""
    best = outcomes[0]
    other = next(each for each in outcomes if each.change == SAME)
    if best.n_tracked <= other.n_tracked:
        return f"no cause found: with only another seed {other.n_tracked} of {other.n} runs keep the track"
    counts = np.array([[each.n_tracked, each.n - each.n_tracked] for each in (best, other)])
    p = scipy.stats.fisher_exact(counts, "greater").pvalue
    return (
        f"most likely: {best.change.name}, with which {best.n_tracked} of {best.n} runs keep the track, with only "
        f"another seed {other.n_tracked} of {other.n} (p = {p:.2g}, Fisher's exact test)"
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """Return a line for every outcome: tracked repetitions with Wilson's 95 % interval, and their error."""
    lines = [" tracked          95 %     error  with"]
    for each in outcomes:
        low, high = scipy.stats.binomtest(each.n_tracked, each.n).proportion_ci(0.95, method="wilson")
        count, interval = f"{each.n_tracked} of {each.n}", f"{low:.0%} to {high:.0%}"
        lines.append(f"{count:>8}{interval:>14}{each.error:>10.4g}  {each.change.name}")
    return "\n".join(lines)
