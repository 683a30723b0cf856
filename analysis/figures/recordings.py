"""The recordings that figures are drawn from: the newest with the required configuration, or new ones."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from analysis.figures.unrecorded import composed
from workbench.recording.read.reader import Run, read
from workbench.utils.errors import InputError

_SYNTHESES = (
    "synthesize_walk", "synthesize_wave", "synthesize_dance", "synthesize_punch", "synthesize_walk_or_run",
    "synthesize_run_to_walk", "synthesize_walk_to_run",
)  # fmt: skip
_FEW = ("dataset.n_frames=16", "inference.n_particles=100")
_FEW_POINTS = ("dataset.n_points=150", "prior.n_components=6", "inference.n_particles=100")
QUICK: Mapping[str, Sequence[str]] = {
    **dict.fromkeys(
        ("walk_straight", "walk_circle", "walk_prior_only", "walk_cyclic"),
        ("dataset.n_frames=21", "inference.n_particles=400"),
    ),
    "arm_twist": ("inference.n_particles=1000",),
    **dict.fromkeys(("arm_implicit", "arm_smooth_300", "arm_implicit_waving", "body_implicit", "body_smooth"), _FEW),
    "arm_smooth_3000": ("dataset.n_frames=16", "inference.n_particles=1000"),
    **dict.fromkeys(("synthesize_run", *_SYNTHESES), ("dataset.n_frames=31",)),
    **dict.fromkeys(("temperature", "temperature_arm"), ("study.n_probes=3",)),
    "particles_by_dimension": (
        "study.max_particles=4096", "study.n_seeds=3", "study.n_frames=4", "study.dims=[1,2,3]",
        "study.dims_body=[1,2,3]",
    ),
    "coefficient_histograms": ("study.n_draws=300",),
    "impute_gaps": ("study.fractions=[0.1,0.2]",),
    "points_no_model": ("dataset.n_frames=16", "dataset.n_points=150", "inference.n_particles=100"),
    **dict.fromkeys(
        (
            "points_walk_steady", "points_walk_variable", "points_run_steady",
            "points_run_variable", "points_particle_filter", "points_hybrid",
        ),
        ("dataset.n_frames=16", *_FEW_POINTS),
    ),
    "points_transition": ("dataset.n_frames=28", *_FEW_POINTS),
}  # fmt: skip
"""Overrides of a small run; experiments not listed are small."""

RECORDED: Mapping[str, Sequence[str]] = {
    "walk_straight": ("dataset.motion='35_02'", "prior.motions=cmu"),
    "walk_prior_only": ("dataset.motion='35_02'", "prior.motions=cmu"),
    "walk_cyclic": ("dataset.motion='35_02'",),
}
"""Overrides that replace a generated walk by a recorded one of a held-out subject, as in the papers."""

AS_IT_STANDS = {("walk_prior_only", "literal")}
"""Readings without a recorded walk: the paper's is on a circle."""

_WALKER = ("dataset.motion=builtin", "prior.motions=builtin", "prior.exclude=[]")
GENERATED: Mapping[str, Sequence[str]] = {
    **dict.fromkeys(("arm_implicit", "arm_implicit_waving", "body_implicit", "synthesize_run"), _WALKER),
    **dict.fromkeys(("arm_smooth_300", "arm_smooth_3000", "body_smooth"), ("dataset.motion=builtin",)),
    **dict.fromkeys(_SYNTHESES, (*_WALKER, "prior.activities=[]", "dataset.first_frame=15")),
    **dict.fromkeys(("temperature", "tree_balance", "coefficient_histograms"), ("prior.motions=builtin",)),
    "temperature_arm": ("prior.motions=builtin", "study.clip=null", "study.frame=null"),
}
"""Overrides that replace recorded motion by generated people; for trials, not for the papers' figures."""

VARIANTS: Mapping[str, tuple[str, ...]] = {
    "arm_implicit": ("arm_smooth_300", "prior=implicit"),
    "arm_smooth_3000": ("arm_smooth_300", "inference.n_particles=3000"),
    "arm_implicit_waving": (
        "arm_smooth_300", "prior=implicit", "training.exclude=[dataset-1_byebye_giant_001]",
        "dataset.motion=dataset-1_byebye_giant_001", "dataset.first_frame=8", "dataset.view_azimuth_deg=180",
    ),
    "temperature_arm": (
        "temperature", "prior.angles=[right_arm]", "prior.include_root=false", "study.clip=dataset-1_byebye_giant_001",
        "study.frame=17", "study.betas=[0.05]",
    ),
    "synthesize_walk": ("synthesize_run", "dataset.motion=dataset-2_walk_normal_001", "dataset.first_frame=60"),
    "synthesize_wave": ("synthesize_run", "dataset.motion=dataset-1_bye_giant_001"),
    "synthesize_dance": (
        "synthesize_run", "dataset.motion=dataset-1_dance-short_normal_001", "dataset.first_frame=600",
        "training.exclude=[]",
    ),
    "synthesize_punch": ("synthesize_run", "dataset.motion=dataset-1_punch_normal_001", "dataset.first_frame=30"),
    "synthesize_walk_or_run": (
        "synthesize_run", "dataset.motion=dataset-2_walk_active_001", "dataset.first_frame=60",
        "prior.activities=[walk,run]", "prior.beta=1",
    ),
    "synthesize_run_to_walk": (
        "synthesize_run", "dataset.motion=dataset-2_run_normal_002", "dataset.first_frame=10", "dataset.n_frames=91",
        "prior.activities=[walk,run]", "prior.beta=1",
    ),
    "synthesize_walk_to_run": (
        "synthesize_run", "dataset.motion=dataset-2_walk_active_001", "dataset.first_frame=60",
        "prior.activities=[run]",
    ),
}  # fmt: skip
"""Names of experiments with additional overrides: the experiment, and the overrides."""

_NO_MATTER = ("paths", "n_threads", "seed", "check", "recorder", "sweep", "assumptions", "clips", "paper")
_PLACES = ("data", "cache")


@dataclass(frozen=True)
class Source:
    """folder: with recordings, old and new. data: recorded motion, None for generated people. quick: accept small
    runs."""

    folder: Path
    data: str | None
    quick: bool

    def variants(self, experiment: str, paper: str = "ours") -> list[list[str]]:
        """Return the overrides that may have made a recording, the best first; the last is that of a new run.

        paper: "literal" for the experiment as its paper writes it. Raises InputError for an experiment that needs
        recorded motion without `data`, unless small runs are accepted.
        """
        recorded = RECORDED.get(experiment, ()) if (experiment, paper) not in AS_IT_STANDS else ()
        data = [] if self.data is None else [f"paths.data={self.data}", *recorded]
        if self.data is None and experiment in GENERATED:
            if not self.quick:
                raise InputError(
                    f"{experiment}: needs recorded motion, --data DATA (or, with generated people, --quick)"
                )
            data = list(GENERATED[experiment])
        reading = [] if paper == "ours" else [f"paper={paper}"]
        small = [*reading, *data, *QUICK.get(experiment, ())]
        data = [*reading, *data]
        return [data, small] if self.quick and small != data else [data]


def chosen(experiment: str) -> list[str]:
    """Return the overrides that choose the experiment, or one of VARIANTS."""
    name, *choice = VARIANTS.get(experiment, (experiment,))
    return [f"experiment={name}", *choice]


def recording(experiment: str, source: Source, recordings: Sequence[Run], paper: str = "ours") -> Run:
    """Return the newest complete run among `recordings` with the experiment's configuration, or else a new one.

    paper: see `Source.variants`. Raises InputError when it cannot be made.
    """
    name = VARIANTS.get(experiment, (experiment,))[0]
    candidates = [run for run in recordings if run.status == "complete" and run.provenance.get("experiment") == name]
    candidates.sort(key=lambda run: run.path.stat().st_mtime, reverse=True)
    for overrides in source.variants(experiment, paper) if candidates else ():
        config: Any = OmegaConf.to_container(composed([*chosen(experiment), *overrides]), resolve=True)
        settings = what_matters(config)
        for run in candidates:
            if what_matters(run.settings) == settings:
                return run
    return _made(experiment, source, paper)


def what_matters(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration without the keys that do not affect the content: seed, paths, threads, recorder."""
    return {key: _without_places(value) for key, value in settings.items() if key not in _NO_MATTER}


def _without_places(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_places(item) for key, item in value.items() if key not in _PLACES}
    return value


def _made(experiment: str, source: Source, paper: str) -> Run:
    words = ["run", *chosen(experiment), *source.variants(experiment, paper)[-1]]
    folder = source.folder / experiment / f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}"
    print(f"  {' '.join(['workbench', *words])}", flush=True)
    command = [sys.executable, "-m", "workbench", *words, f"hydra.run.dir={folder}"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    if done.returncode:
        raise InputError(f"{experiment}: the run ended with exit code {done.returncode}")  # and has said why
    return read(folder / "run.rrd")
