"""The tables of the pages beyond those of the papers: by name, the runs of every row and the columns."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from analysis.figures.cached_runs import Run
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import Result, composed
from analysis.tables import video
from analysis.tables.papers import EXACT, IMAGES, POINTS, SUBJECTS, of_subjects, over_seeds, with_deviations
from analysis.tables.real import REAL_TABLES
from analysis.tables.table import (
    NONE,
    RUNS,
    TRACKED,
    Column,
    Labels,
    Results,
    Table,
    between_people,
    between_seeds,
    mean,
    over_runs,
)
from workbench.evaluation.uncertainty.step_calibration import GROUPS
from workbench.experiment.config.resolvers import RESOLVERS

Rows = Mapping[Labels, tuple[str, Sequence[str]]]
"""Experiment and overrides by the first cells of a row."""


def perturbed(*sizes: str) -> tuple[str, ...]:
    """Return the overrides of a run in which only these perturbations are not zero."""
    return *EXACT, f"dataset.perturbations={{{', '.join(sizes)}}}"


PERTURBATIONS: Rows = {
    (name,): ("walk_multi_cue", ("inference.n_particles=300", "dataset.n_frames=30", *overrides))
    for name, overrides in {
        "none (`dataset.perturb=false`)": EXACT,
        "all of the next five (default)": (),
        "bone lengths 3 %, limb girths 10 %": perturbed("lengths: 0.03", "radii: 0.1"),
        "limb profile, neck, feet": perturbed("profile: 1.0"),
        "clothing 5 mm": perturbed("clothes_m: 0.005"),
        "camera 0.2 %, 0.1°": perturbed("camera: 0.002", "camera_deg: 0.1"),
        "initial pose 3 cm, 0.05 rad": perturbed("start_m: 0.03", "start_rad: 0.05"),
        "camera 1 %, 1°": perturbed("camera: 0.01", "camera_deg: 1.0"),
        **{f"body model scaled by {scale}": (*EXACT, f"body.scale={scale}") for scale in (0.95, 0.98, 1.02, 1.05)},
        "view at 45°": (*EXACT, "dataset.view_azimuth_deg=45"),
        "frontal view": (*EXACT, "dataset.view_azimuth_deg=180"),
    }.items()
}
WALKERS = ("35_02", "38_02", "39_02")
"""Walkers from whom the prior of walk_multi_cue is not learned."""
FROM_THE_START = ("dataset.first_frame=0",)
"""Some walks are short, and points are at 14 Hz."""
FILTERED = (
    "prior=ar_offsets", "inference=particle_filter", "prior.base.initial_position_std=0.03",
    "prior.base.initial_rotation_std=0.05",
)  # fmt: skip
CALIBRATED: Rows = {
    (name, yes_or_no): (experiment, ("dataset.n_frames=30", *overrides, *exact))
    for name, (experiment, overrides) in {
        "points, one style": ("points_walk_steady", FROM_THE_START),
        "points, variable style": ("points_walk_variable", FROM_THE_START),
        "keypoints, least squares": ("walk_keypoints_synthetic", ()),
        "keypoints, particle filter": ("walk_keypoints_synthetic", FILTERED),
        "images, particle filter": ("walk_multi_cue", ()),
    }.items()
    for yes_or_no, exact in (("yes", ()), ("no", EXACT))
}
HELD_OUT: Rows = {
    ("`linear`",): ("held_out_subjects", ("prior=linear",)),
    ("`smooth`, an independent prior for each angle",): ("held_out_subjects", ("prior=smooth",)),
}
CUES = "likelihood.weights={{appearance: {0}, edges: {0}, silhouette: {0}}}"
TUNED: Rows = {
    (name, f"{value:g}"): (experiment, ("dataset.n_frames=25", *others, override.format(value)))
    for name, experiment, override, values, others in (
        ("weight of each cue in `walk_multi_cue`", "walk_multi_cue", CUES, (0.5, 0.25, 0.12, 0.06), ()),
        ("`effective_pixels` of image motion alone, in `coverage`", "coverage", "likelihood.effective_pixels={0}",
         (1.0, 0.3, 0.1, 0.03), ()),
        ("`likelihood_power` of keypoints, particle filter", "walk_keypoints_synthetic",
         "likelihood.likelihood_power={0}", (1.0, 0.3, 0.1), ("prior=ar_offsets", "inference=particle_filter")),
        ("`common_bias_std_m` of points (m)", "points_walk_steady", "likelihood.common_bias_std_m={0}",
         (0.0, 0.006, 0.012, 0.024), ()),
    )
    for value in values
}  # fmt: skip


def over_people(
    rows: Rows, clips: Callable[[Source], Sequence[str]], usual_seeds: int
) -> Callable[[Source, int | None], dict[Labels, list[Run]]]:
    """Return the function of the runs of rows over clips and seeds."""

    def runs(source: Source, n_seeds: int | None) -> dict[Labels, list[Run]]:
        return {
            labels: [
                Run(labels[0], experiment, clip, seed, (f"paths.data={source.data}", *overrides))
                for clip in clips(source)
                for seed in range(n_seeds or usual_seeds)
            ]
            for labels, (experiment, overrides) in rows.items()
        }

    return runs


def listed(name: str, source: Source) -> list[str]:
    """Return the clips of a list in conf/config.yaml."""
    return list(composed([f"paths.data={source.data}"]).clips[name])


def held_out(split: str, source: Source) -> list[str]:
    """Return the clips of a split of experiment=held_out_subjects."""
    return list(RESOLVERS["clips_of"](composed([f"paths.data={source.data}"]).clips.held_out, split))


def calibration(columns: Sequence[Column]) -> Table:
    """Return the table of the posteriors of test walkers."""
    return Table(("experiment", "perturbed"), over_people(CALIBRATED, partial(listed, "test"), 2), columns)


def lowest_nll(results: Mapping[Labels, Results]) -> set[Labels]:
    """Return the row of lowest mean negative log likelihood of each parameter."""
    nll = {labels: mean("nll", 9).cell(row) for labels, row in results.items()}
    known = {labels: float(cell) for labels, cell in nll.items() if cell != NONE}
    return {min((each for each in known if each[0] == name), key=known.__getitem__) for name, _ in known}


def main_results(source: Source, n_seeds: int | None) -> dict[Labels, list[Run]]:
    """Return the runs of the table of the README."""
    videos = video.runs(source, None)
    unseen = "six recorded walkers, rendered, not used for learning or tuning"
    return {
        ("`workbench run`", "one generated walker, one rendered camera"): [
            Run("default", "walk_multi_cue", "", 0, ("paths.data=null",))
        ],
        ("`workbench run -m experiment=walk_multi_cue paths.data=DATA`", unseen): of_subjects(
            "walk_multi_cue", "ours", source, n_seeds
        ),
        ("`workbench track`", "a woman in one video, 390 px tall, without calibration; settings were chosen with her "
         "in view"): videos["woman, no camera",],
        ("`workbench track`", "a man before four cameras, likewise"): videos["man, four cameras",],
    }  # fmt: skip


def coverage(results: Mapping[Run, Result]) -> float:
    """Return the percentage of values in their 90 % intervals, of parameters or, without a true pose, of joints."""
    names = ("coverage_90", "coverage_90_joints")
    values = [result.metrics[name] for result in results.values() for name in names if name in result.metrics]
    return 100.0 * float(np.mean(values)) if values else float("nan")


_SUBJECT_ERRORS = with_deviations(("mpjpe_abs_mm", 0), ("mpjpe_px", 1), ("mpjpe_mm", 0))
_OVER_RUNS = [
    over_runs(metric, statistic, digits, f"{words} `{metric}`")
    for metric, digits in (("mpjpe_abs_mm", 0), ("mpjpe_px", 1), ("mpjpe_mm", 0))
    for words, statistic in (("mean", np.mean), ("median", np.median))
]
_TEST = partial(held_out, "test")
TABLES: Mapping[str, Table] = {
    "papers_images": over_seeds(IMAGES, ()),
    "papers_images_exact": over_seeds(IMAGES, EXACT),
    "papers_points": over_seeds(POINTS, ()),
    "papers_points_exact": over_seeds(POINTS, EXACT),
    "subjects": SUBJECTS,
    "perturbations": Table(
        ("mismatched quantity",), over_people(PERTURBATIONS, lambda _: WALKERS, 3),
        [
            column for metric, digits in (("mpjpe_abs_mm", 0), ("mpjpe_px", 1))
            for column in (mean(metric, digits), between_people(metric, digits, "SD between subjects"),
                           between_seeds(metric, digits))
        ] + [TRACKED],
    ),
    "calibration_coverage": calibration(
        [*with_deviations(("coverage_90", 2)), *(mean(f"coverage_90_{group}", 2, group) for group in GROUPS)]
    ),
    "calibration_scores": calibration(
        [*(mean(name, 1) for name in ("nees_per_dim", "crps_mm", "crps_deg")), *with_deviations(("mpjpe_abs_mm", 0)),
         mean("mpjpe_px", 1)]
    ),
    "tuned_parameters": Table(
        ("parameter", "value"), over_people(TUNED, partial(listed, "validation"), 1),
        [mean("nll", 2), mean("crps_mm", 1), mean("crps_deg", 2), mean("coverage_90", 2), mean("nees_per_dim", 1),
         mean("mpjpe_abs_mm"), RUNS], lowest_nll, "lowest `nll`",
    ),
    "held_out_subjects": Table(
        ("prior",), over_people(HELD_OUT, _TEST, 3), [*_SUBJECT_ERRORS, mean("coverage_90", 2), TRACKED, RUNS]
    ),
    "held_out_runs": Table(("prior",), over_people(HELD_OUT, _TEST, 3), _OVER_RUNS),
    **REAL_TABLES,
    "video": video.VIDEO,
    "results": Table(
        ("command", "subjects"), main_results,
        [*with_deviations(("mpjpe_abs_mm", 0)), mean("mpjpe_px", 1),
         Column("in the 90 % intervals (%)", coverage)],
    ),
}  # fmt: skip
