"""Tables of the papers' experiments, as published and ours: over seeds, and over test subjects."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from analysis.figures.cached_runs import Run
from analysis.figures.people import clip_overrides, report_clips
from analysis.figures.recordings import AS_IT_STANDS, Source, chosen
from analysis.figures.replicates import PAPERS, runs_of
from analysis.figures.unrecorded import composed
from analysis.tables.table import (
    PEOPLE,
    RUNS,
    TRACKED,
    Column,
    Labels,
    Results,
    Table,
    between_people,
    interval,
    mean,
    of_people,
)
from workbench.utils.errors import InputError

IMAGES = {
    "A 4": "arm_twist", "A 5": "walk_straight", "A 6": "walk_circle", "A 7": "walk_prior_only", "B 2": "walk_cyclic",
    "C 6 a": "arm_implicit", "C 6 b": "arm_smooth_300", "C 6": "arm_smooth_3000", "C 7 a": "body_implicit",
    "C 7 b": "body_smooth",
}  # fmt: skip
POINTS = {
    "D 3": "points_no_model", "D 5": "points_walk_steady", "D 9": "points_walk_variable", "D 7": "points_run_steady",
    "D 8": "points_run_variable", "D 10": "points_transition",
}  # fmt: skip
"""Experiments by figure."""
ON_SUBJECTS = (
    "walk_straight", "walk_circle", "walk_prior_only", "walk_keypoints_synthetic", "walk_cyclic", "body_implicit",
    "body_smooth", "points_no_model", "points_walk_steady", "points_walk_variable", "points_run_steady",
    "points_run_variable", "points_transition", "points_full", "stereo_walk", "points_particle_filter", "points_hybrid",
    "walk_multi_cue",
)  # fmt: skip
VERSION = {"literal": "as published", "ours": "ours"}
EXACT = ("dataset.perturb=false",)
N_SEEDS_SUBJECTS = 2
"""Seeds of every test subject, as in the sweep of walk_multi_cue."""


def over_seeds(experiments: Mapping[str, str], more: Sequence[str]) -> Table:
    """Return the table of experiments by figure over ten seeds; rows that are nearer as published are marked."""

    def rows(source: Source, n_seeds: int | None) -> dict[Labels, list[Run]]:
        return {
            (figure, f"`{experiment}`", VERSION[paper]): runs_of(experiment, paper, source, n_seeds, more)
            for figure, experiment in experiments.items()
            for paper in PAPERS
        }

    second, digits = ("knee_flexion_rmse_deg", None) if experiments is POINTS else ("mpjpe_px", None)
    columns = [
        mean("mpjpe_abs_mm"), *interval("mpjpe_abs_mm", 0), mean("mpjpe_mm"), mean(second, digits), *interval(second),
        TRACKED, RUNS,
    ]  # fmt: skip
    return Table(("figure", "experiment", "version"), rows, columns, nearer, "nearer as published than ours")


def nearer(results: Mapping[Labels, Results]) -> set[Labels]:
    """Return the rows as published whose mean error in space is below that of ours."""
    means = {
        labels: of_people({run: result for run, result in row.items() if result is not None}, "mpjpe_abs_mm")
        for labels, row in results.items()
    }
    published = [labels for labels in means if labels[-1] == VERSION["literal"]]
    return {labels for labels in published if means[labels] and means[labels] < means[*labels[:-1], VERSION["ours"]]}


def on_subjects(source: Source, n_seeds: int | None) -> dict[Labels, list[Run]]:
    """Return the runs of experiments over test subjects; of generated walkers, each seed is another subject."""
    rows: dict[Labels, list[Run]] = {}
    for experiment in ON_SUBJECTS:
        for paper in PAPERS:
            if paper == "ours" or ((experiment, paper) not in AS_IT_STANDS and in_a_paper(experiment)):
                rows[f"`{experiment}`", VERSION[paper]] = of_subjects(experiment, paper, source, n_seeds)
    return rows


def of_subjects(experiment: str, paper: str, source: Source, n_seeds: int | None) -> list[Run]:
    """Return the runs of an experiment over test subjects."""
    overrides = source.variants(experiment, paper)[-1]
    config = composed([*chosen(experiment), *overrides])
    try:
        listed = report_clips(config)
    except InputError:  # generated walkers
        motion = f"dataset.motion={config.dataset.motion}"
        runs = runs_of(experiment, paper, source, n_seeds)
        return [replace(run, clip=f"generated {run.seed}", overrides=(*run.overrides, motion)) for run in runs]
    of_clips = {clips: (*overrides, *clip_overrides(config, clips)) for clips in listed}
    return [
        Run(paper, experiment, clips[0], seed, of_clips[clips])
        for clips in listed
        for seed in range(n_seeds or N_SEEDS_SUBJECTS)
    ]


def in_a_paper(experiment: str) -> bool:
    """Return whether an experiment has a version as published."""
    try:
        composed([*chosen(experiment), "paper=literal"])
    except InputError as error:
        if "is in none of the papers" in str(error):
            return False
        raise
    return True


def with_deviations(*metrics: tuple[str, int | None]) -> list[Column]:
    """Return the columns of means and standard deviations between subjects."""
    return [column for name, digits in metrics for column in (mean(name, digits), between_people(name, digits))]


SUBJECTS = Table(
    ("experiment", "version"), on_subjects,
    [
        PEOPLE,
        *with_deviations(("mpjpe_abs_mm", 0), ("mpjpe_mm", 0), ("mpjpe_px", None), ("knee_flexion_rmse_deg", None)),
        mean("coverage_90", 2), TRACKED, RUNS,
    ],
)  # fmt: skip
