"""Claims that are measured on recorded motion and on the database, without a run of an experiment."""

import os
from collections.abc import Mapping, Sequence
from functools import cache, partial

import numpy as np
from scipy.optimize import linprog

from analysis.benchmarks import draws
from analysis.benchmarks.measuring import fastest_s
from analysis.claims.claim import SeedResults, Verdict, mean
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import composed
from workbench.body.kinematics import forward, joints
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.body.surface import attach, person_surface, residual_jacobian, residuals
from workbench.evaluation.uncertainty.step_calibration import GROUPS
from workbench.experiment.config.instantiate import build
from workbench.motion.formats.names import style
from workbench.motion.models.activities import learn_activities, min_components
from workbench.motion.models.activity_cycles import ActivityCycles, activity_cycles
from workbench.motion.models.training import database_motions
from workbench.motion.sources import find_motion
from workbench.priors.implicit_search import kd_tree, search
from workbench.priors.implicit_tree import draw, sign_tree
from workbench.studies.gap_errors import ImputeGaps, gappy_sequences
from workbench.studies.learning import cyclic
from workbench.utils.arrays import BoolArray, FloatArray

SIZES = (12_500, 25_000, 50_000, 100_000)
"""Entries of a database; that of paper C has 50 000."""
LIMB_GROUPS = ("arms", "legs")
FRAMES_HZ, N_FRAMES = 30.0, 50  # of experiment=walk_straight
CYCLES = {"walk": 36, "run": 28}
"""Cycles of every person in paper D's database: four at each of 9 speeds of walking and 7 of running."""
SYNTHESIS_HZ, SYNTHESIS_FRAMES = 30.0, 60
CACHE = os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")


@cache
def own_motions_mm(motion: str, data: str | None) -> dict[str, float]:
    """Return the root mean square distances of a motion's joints from their means, relative to the root, by group."""
    clip = find_motion(motion, data=data, rate_hz=FRAMES_HZ)
    places = joints(person_skeleton(clip.shape), clip.resampled(FRAMES_HZ).poses[:N_FRAMES])
    relative = places - places[:, :1]
    squares = ((relative - relative.mean(axis=0)) ** 2).sum(axis=2).mean(axis=0)
    inside = {group: [any(word in name for word in GROUPS[group]) for name in JOINT_NAMES] for group in LIMB_GROUPS}
    return {group: 1e3 * float(np.sqrt(squares[chosen].mean())) for group, chosen in inside.items()}


def arms_poorest(source: Source, results: SeedResults) -> Verdict:
    """Return whether the arms' error, divided by their own motion, exceeds the legs' in a walk seen from its side."""
    motion = "builtin" if source.data is None else "35_02"
    motions = own_motions_mm(motion, source.data)
    arms, legs = (mean(results, f"mpjpe_{group}_mm") / motions[group] for group in LIMB_GROUPS)
    return Verdict(arms > legs, f"error over own motion: arms {arms:.2f}, legs {legs:.2f}")


def gaps_filled(method: str, source: Source, results: SeedResults) -> Verdict:
    """Return whether the errors of samples imputed by a method, by the suffix of its metrics, are below those of linear
    interpolation and of the mean cycle of all walks."""
    errors, missing = results[0].metrics, [f"rmse_deg_{percent}" for percent in (10, 20, 30)]
    linear = max(errors[name + method] / errors[f"{name}_linear"] for name in missing if name + method in errors)
    walks = ImputeGaps(motions="cmu" if source.data else "builtin", data=source.data, cache=CACHE).walks()
    truths, gappy, alignment = gappy_sequences(cyclic(walks)[0], 0.2, np.random.default_rng(0))
    mean, residuals = alignment.reference, []
    for i, (truth, series) in enumerate(zip(truths, gappy, strict=True)):
        rows = np.rint(alignment.phases(i, len(truth)) * len(mean)).astype(np.int64) % len(mean)
        residuals.append((mean[rows] - truth)[np.isnan(series)])
    over_mean = errors[f"rmse_deg_20{method}"] / float(np.degrees(np.sqrt(np.mean(np.concatenate(residuals) ** 2))))
    numbers = f"error over interpolation's {linear:.2f}, over the mean cycle's {over_mean:.2f}"
    return Verdict(max(linear, over_mean) < 1.0, numbers)


def activities_apart(source: Source) -> Verdict:
    """Return whether at most 8 components explain 90 % of walking and running, and a line separates the activities in
    the first two. As in paper D the styles are natural, and no person has more than CYCLES. The numbers with 8 cycles
    of a person and activity, with all cycles, and with acted styles are given too."""
    every = database_motions(
        "recorded" if source.data else "builtin", data=source.data, cache=CACHE, activities=("walk", "run")
    )
    cycles = activity_cycles(every, max_per_clip=4)
    natural = cycles.only(np.array([style(source) in (None, "bandai-normal") for source in cycles.sources]))
    persons = {motion.name: motion.subject for motion in every}
    databases = {
        "as in D": at_most(natural, persons, CYCLES), "8 of a person": at_most(natural, persons, {"walk": 8, "run": 8}),
        "all": natural, "with acted styles": at_most(cycles, persons, CYCLES),
    }  # fmt: skip
    numbers = []
    for name, database in databases.items():
        model = learn_activities(database, angles=["body"], n_components=2)
        right = separated(model.scores, np.array(model.activities) == "run")
        numbers.append((min_components(model.explained, 0.9), right, f"{name}, {len(database)} cycles"))
    words = [f"{n} components, {right:.1%} separated ({name})" for n, right, name in numbers]
    return Verdict(numbers[0][0] <= 8 and numbers[0][1] == 1.0, "; ".join(words))


def at_most(cycles: ActivityCycles, persons: Mapping[str, str], limits: Mapping[str, int]) -> ActivityCycles:
    """Return evenly spaced cycles, of each person at most the limit of each activity. persons: by source."""
    groups = [(persons[source], name) for source, name in zip(cycles.sources, cycles.activities, strict=True)]
    mask = np.zeros(len(cycles), dtype=bool)
    for group in dict.fromkeys(groups):
        rows = np.flatnonzero([each == group for each in groups])
        n = min(len(rows), limits[group[1]])
        mask[rows[((np.arange(n) + 0.5) * len(rows) / n).astype(np.int64)]] = True
    return cycles.only(mask)


def separated(points: FloatArray, labels: BoolArray) -> float:
    """Return the fraction of points (n, 2) on the right side of the line of least hinge loss (linear programming)."""
    features = np.where(labels, 1.0, -1.0)[:, None] * np.column_stack([points, np.ones(len(points))])
    n, cost = len(points), np.r_[np.zeros(3), np.ones(len(points))]
    bounds = [(None, None)] * 3 + [(0.0, None)] * n
    line = linprog(cost, -np.column_stack([features, np.eye(n)]), -np.ones(n), bounds=bounds).x[:3]
    return float(np.mean(features @ line > 0.0))


def gait(hip_difference: Sequence[float] | FloatArray, rate_hz: float) -> tuple[float, float]:
    """Return the step frequency, Hz, and the coefficient of variation of the times between steps, which are the sign
    changes of the left hip's flexion minus the right's, without its mean; NaN for fewer than three steps."""
    values = np.asarray(hip_difference) - np.mean(hip_difference)
    k = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    times = np.diff(k + values[k] / (values[k] - values[k + 1])) / rate_hz
    return (float(1.0 / times.mean()), float(times.std() / times.mean())) if len(times) > 1 else (np.nan, np.nan)


@cache
def recorded_gaits(data: str | None) -> FloatArray:
    """Return step frequency and variation (n, 2) of two seconds of every run in the database."""
    runs = database_motions("recorded" if data else "builtin", data=data, cache=CACHE, activities=("run",))
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") for side in ("left", "right"))
    gaits = []
    for motion in (run.resampled(SYNTHESIS_HZ) for run in runs):
        if len(motion) >= SYNTHESIS_FRAMES:
            poses = motion.poses[:SYNTHESIS_FRAMES]
            gaits.append(gait(poses[:, left] - poses[:, right], SYNTHESIS_HZ))
    return np.array(gaits)


def gait_within_recorded(source: Source, results: SeedResults) -> Verdict:
    """Return whether steps are as frequent and as regular as those of recorded runs in 8 of 10 seeds."""
    recorded = recorded_gaits(source.data)
    (low, _), (high, most) = np.nanmin(recorded, axis=0), np.nanmax(recorded, axis=0)
    made = np.array([gait(result.series["hip_difference_deg"], SYNTHESIS_HZ) for result in results])
    n = int(((made[:, 0] >= low) & (made[:, 0] <= high) & (made[:, 1] <= most)).sum())
    frequency, variation = np.nanmean(made, axis=0)
    recorded_range = f"recorded {low:.1f}–{high:.1f} Hz, at most {most:.2f}"
    numbers = f"{n} of {len(made)}: {frequency:.1f} Hz, variation {variation:.2f} ({recorded_range})"
    return Verdict(n >= 0.8 * len(made), numbers)


def search_time(paper: str, source: Source) -> Verdict:
    """Return whether the time of a draw grows with less than the square root of the number of entries."""
    _, library, others = draws.motions(source.data)
    timed = []
    for size in SIZES:
        coefficients, probes = draws.database(size, library, others, draws.N_PARENTS)
        rng = np.random.default_rng(1)
        if paper == "literal":
            tree, uniforms = sign_tree(coefficients), rng.random((len(probes), coefficients.shape[1] + 1))
            timed.append(partial(draw, tree, probes, draws.BETA, uniforms, "uniform"))
        else:
            counts = np.full(len(probes), draws.N_CHILDREN)
            uniforms = rng.random(counts.sum())
            timed.append(partial(search, kd_tree(coefficients), probes, counts, draws.BETA, uniforms))
    exponent = float(np.polyfit(np.log(SIZES), np.log(fastest_s(timed)), 1)[0])
    return Verdict(exponent < 0.5, f"exponent {exponent:.2f} for {SIZES[0]} to {SIZES[-1]} entries")


def jacobian_cost(source: Source) -> Verdict:
    """Return whether the residuals of points with their Jacobian take less than four times the time of the residuals,
    for every joint of a recorded skeleton."""
    config = composed(["experiment=points_full", *source.variants("points_full")[-1]])
    clip = build(config.dataset)
    frame, body = next(iter(clip.frames())), clip.info.body
    surface, pose, skeleton = person_surface(body), frame.truth.pose, body.skeleton
    attachment = attach(surface, forward(skeleton, pose[None]), frame.points)
    arguments = (skeleton, surface, pose, frame.points, "distance", attachment)
    alone, both = fastest_s([partial(residuals, *arguments), partial(residual_jacobian, *arguments)], repeats=200)
    numbers = f"ratio {both / alone:.2f} for {len(pose)} degrees of freedom, {len(frame.points)} points"
    return Verdict(both < 4.0 * alone, numbers)
