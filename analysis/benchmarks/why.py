"""How often workbench diagnose names the cause of a loss that was planted: python -m analysis.benchmarks.why FOLDER.

A built-in walker is rendered and tracked with few particles, with one thing wrong. A scene counts where the run loses
the person with it and does not without it; scenes are gone through by their seeds until there are enough. Then every
change is tried, and the cause should come first.
"""

import argparse
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_module
from scipy.stats import binomtest

from workbench.datasets.rendering import occluder
from workbench.datasets.synthetic import Synthetic
from workbench.experiment.branch import branched
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.execute import execute
from workbench.inference.smc.reinitializing import mirrored
from workbench.recording.read.reader import Run, read
from workbench.results.why.changes import changes_of
from workbench.results.why.futures import all_futures, losses, past_of
from workbench.results.why.verdict import Verdict, ranked, table, verdict
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

SCENE = (
    "experiment=custom", "dataset=synthetic", "dataset.n_frames=40", "dataset.width=320", "dataset.height=240",
    "dataset.person_px=135", "dataset.focal_px=350", "learn.motions=builtin", "prior=walking", "likelihood=product",
    "likelihood.weights.image_motion=0", "likelihood.weights.background=0", "likelihood.weights.edges=0.3",
    "likelihood.weights.appearance=0.3", "likelihood.weights.silhouette=0.3", "inference.n_particles=100", "threads=1",
    "paths.data=null",
)  # fmt: skip
SCENES = range(100, 130)
"""Seeds of the scenes, by which nothing was chosen."""


@dataclass(frozen=True)
class Planted:
    """Something wrong. common: overrides of the run with it and without. wrong: of the run with it. causes: changes
    that undo it. swapped: the start is told with left and right exchanged."""

    common: tuple[str, ...]
    wrong: tuple[str, ...]
    causes: tuple[str, ...]
    swapped: bool = False


PLANTED = {
    "an occluder": Planted((), ("dataset.occluder=true",), ("nothing in front of the person",)),
    "a wrong height": Planted((), ("body.scale=1.3",), ("the person's own lengths",)),
    "left and right swapped": Planted((), (), ("left and right exchanged",), swapped=True),
    "a camera turned by 2°": Planted(
        ("prior.sigma_position=[0.004,0.004,0.004]",), ("dataset.departures={camera_deg:2.0}",),
        ("the camera as it is",),
    ),
    "a cue that misleads": Planted(
        (), ("likelihood.weights.silhouette=3", "likelihood.terms.silhouette.rim_px=12"), ("without silhouette",)
    ),
    "a wrong prior": Planted((), ("prior=smooth",), ("prior=jitter",)),
}  # fmt: skip


def main() -> None:
    """Plant causes and count how often they come first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the runs are kept")
    parser.add_argument("--cases", type=int, default=5, help="of each cause (default: 5)")
    parser.add_argument("--seeds", type=int, default=3, help="of each change (default: 3)")
    parser.add_argument("--only", help="one cause alone")
    arguments = parser.parse_args()
    logging.getLogger().setLevel(logging.ERROR)
    warnings.simplefilter("ignore")
    prepare_hydra()
    first = total = 0
    for name, planted in PLANTED.items():
        if arguments.only in (None, name):
            ranks = [_rank(run, planted, arguments) for run in lost_runs(name, planted, arguments)]
            print(f"{name}: first in {ranks.count(1)} of {len(ranks)}, ranks {ranks}", flush=True)
            first, total = first + ranks.count(1), total + len(ranks)
    interval = binomtest(first, total).proportion_ci(0.95, method="wilson")
    print(f"all: first in {first} of {total} ({first / total:.0%}, {interval.low:.0%} to {interval.high:.0%})")


def lost_runs(name: str, planted: Planted, arguments: argparse.Namespace) -> Iterator[Run]:
    """Yield runs that the cause alone makes lose the person."""
    found = 0
    for seed in SCENES:
        if found == arguments.cases:
            return
        folder = arguments.folder / name.replace(" ", "_") / str(seed)
        overrides = (*SCENE, *planted.common, f"dataset.seed={seed}", _cache(arguments.folder))
        if losses(_run(folder / "right", overrides)):
            continue
        with _scenes(planted.swapped):
            run = _run(folder / "wrong", (*overrides, *planted.wrong))
            if losses(run):
                found += 1
                yield run


def _run(folder: Path, overrides: tuple[str, ...]) -> Run:
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=list(overrides))
    del config.sweep
    execute(config, "custom", folder, quiet=True)
    return read(folder / "run.rrd")


@contextmanager
def _scenes(swapped: bool) -> Iterator[None]:
    """Let boards hide the whole person, as narrower ones lose nobody here, and scenes tell a swapped first pose."""
    start, sizes = Synthetic.__dict__["_start"], (occluder.WIDTH, occluder.HEIGHT)

    def mirrored_start(self: Synthetic) -> FloatArray:
        return mirrored(np.asarray(start.func(self)))

    told = cached_property(mirrored_start)
    told.__set_name__(Synthetic, "_start")
    occluder.WIDTH, occluder.HEIGHT = (1.0, 1.2), (1.1, 1.2)
    setattr(Synthetic, "_start", told if swapped else start)  # noqa: B010 (a method may not be assigned to)
    try:
        yield
    finally:
        occluder.WIDTH, occluder.HEIGHT = sizes
        setattr(Synthetic, "_start", start)  # noqa: B010


def _cache(folder: Path) -> str:
    """Keep these scenes, which are not as others are, apart."""
    return f"paths.cache={folder.resolve() / 'cache'}"


def _rank(run: Run, planted: Planted, arguments: argparse.Namespace) -> int:
    """Return the place, from 1 on, at which the cause comes among the changes; one behind all where it cannot."""
    loss, overrides = losses(run)[0], [_cache(arguments.folder)]
    past = past_of(run, loss, overrides)
    drawn = list(range(1000, 1000 + arguments.seeds))
    changes = changes_of(branched(run, overrides)[0], from_start=past is None)
    tasks = [(run.path, past, loss, change, drawn, overrides) for change in changes]
    found: list[Verdict] = []
    for each in all_futures(tasks, jobs=1):
        if not isinstance(each, InputError):
            found.append(verdict(each))
    order = ranked(found)
    print(f"{run.path}, lost in frame {loss.frame}\n{table(order)}", flush=True)
    names = [each.change.name for each in order]
    return min((names.index(cause) + 1 for cause in planted.causes if cause in names), default=len(names) + 1)


if __name__ == "__main__":
    main()
