"""The automatic start: where in its cycle a motion is, and how fast it runs, from the first frames alone.

Paper D sets the phases of the first and last frame by hand. A start off by 0.2 of a cycle ends in a wrong minimum, so
every phase is tried instead: a table of costs, frame by phase, with the root fitted in every cell. A motion of constant
frequency is a straight line through the table; the best few lines are refined by least squares over all unknowns.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.prior import MotionModel
from workbench.inference.least_squares.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.single_frame import (
    WIDENED,
    FitData,
    MotionDecoder,
    PoseDecoder,
    fit_frame,
    fit_root,
)
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

N_FRAMES = 8
N_PHASES = 12
N_RATES = 8
N_REFINED = 4
TABLE_WIDENED = 2.0
"""Factor of the loss's scale in the table, whose phases are never quite right."""
SPEED_MARGIN = 1.25
"""How much slower or faster than any example of the model a motion may be."""
LEAST_TRAVEL_M = 0.1
"""Over the first frames; less tells nothing about where a person faces."""
N_HEADINGS = 8
_FINE = 4  # phases between two of the table that lines may start at
_APART = 0.1  # cycles between lines that are worth refining both


def find_phase(decoder: MotionDecoder, data: FitData, root: FloatArray) -> FloatArray:
    """Find states (F, D) of the first F ≤ N_FRAMES of the frames, each of which shows something. root: (6,) about where
    the person is in the first one, or several guesses (n, 6)."""
    data = data.some(np.arange(len(data.times_s))[:N_FRAMES])
    frames, times_s = np.arange(len(data.times_s)), data.times_s
    lines: list[tuple[float, FloatArray]] = []
    tried = list(product(_activity_styles(decoder.model), np.atleast_2d(root)))
    for (alpha, rates_hz), guess in tqdm(tried, desc="phase", unit="grid", disable=None, leave=False):
        costs, roots = _phase_table(decoder, data, alpha, guess)
        for cost, phases in best_lines(costs, times_s, _fine_enough(rates_hz, times_s)):
            cells = np.round(phases * N_PHASES).astype(int) % N_PHASES
            lines.append((cost, decoder.states(alpha, phases, roots[frames, cells])))
    lines.sort(key=lambda line: line[0])
    problem = fit_problem(decoder, data, len(frames))
    refined = [fit_motion(problem, states, max_iterations=15, tolerance=1e-3) for _, states in lines[:N_REFINED]]
    return min(refined, key=lambda fit: fit[2].costs[-1])[0]


def _phase_table(
    decoder: MotionDecoder, data: FitData, alpha: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Tabulate costs (F, N_PHASES) and roots (F, N_PHASES, 6) of every frame at phases 0, 1/N_PHASES, …, root fitted.

    The root of a frame starts from that of the best phase in the frame before, or in the first one from the phase that
    fits best as it is, at first with a wide loss.
    """
    costs, roots = np.empty((len(data.times_s), N_PHASES)), np.empty((len(data.times_s), N_PHASES, N_ROOT))
    poses = decoder.poses(decoder.states(alpha, np.arange(N_PHASES) / N_PHASES, root))
    free, wide, near = PoseDecoder(decoder.skeleton), data.loss.wider(TABLE_WIDENED), list(poses)
    for t, residual in enumerate(data.residuals):
        poses[:, :N_ROOT] = fit_root(free, residual, data.loss, near, WIDENED[:1])
        for k, pose in enumerate(poses):
            fit = fit_frame(free, residual, wide, pose, free=np.arange(N_ROOT), max_iterations=6, tolerance=1e-2)
            costs[t, k], roots[t, k] = fit.costs[-1], fit.x[:N_ROOT]
        best = int(costs[t].argmin())
        poses[:, :N_ROOT] = roots[t, best]
        near = [poses[best]]
    return costs, roots


def best_lines(costs: FloatArray, times_s: FloatArray, rates_hz: FloatArray) -> list[tuple[float, FloatArray]]:
    """Return the N_REFINED best lines through a table (F, N): cost and phases (F,), cycles, no two of them close."""
    frames, n_phases = np.arange(len(costs)), costs.shape[1]
    starts = np.arange(_FINE * n_phases) / (_FINE * n_phases)
    phases = starts[:, None, None] + rates_hz[:, None] * (times_s - times_s[0])  # (start, rate, frame)
    place = phases * n_phases
    low, part = np.floor(place).astype(int), place - np.floor(place)
    sums = ((1.0 - part) * costs[frames, low % n_phases] + part * costs[frames, (low + 1) % n_phases]).sum(axis=-1)
    chosen: list[tuple[float, FloatArray]] = []
    for k in np.argsort(sums, axis=None, kind="stable"):
        line = phases[np.unravel_index(k, sums.shape)]
        if all(np.abs((line - other + 0.5) % 1.0 - 0.5).mean() > _APART for _, other in chosen):
            chosen.append((float(sums.flat[k]), line))
        if len(chosen) == N_REFINED:
            break
    return chosen


def roots_from_points(skeleton: Skeleton, points: Sequence[FloatArray], times_s: FloatArray) -> FloatArray:
    """Return rough roots (n, 6) in the first of some frames of points (K, 3), m: upright, where most points are, facing
    the way they move over the first frames, or every way (N_HEADINGS) where they move too little to tell. Raises
    InputError without points in two of the first frames. Medians stand outliers, but not a wall behind."""
    shown = [t for t, cloud in enumerate(points[:N_FRAMES]) if len(cloud)]
    if len(shown) < 2:
        raise InputError("least squares: expected points in two of the first frames or more, found none to start from")
    middles = np.array([np.median(points[t], axis=0) for t in shown])
    line = np.polynomial.polynomial.polyfit(times_s[shown] - times_s[0], middles, 1)
    travel = line[1, :2] * (times_s[shown[-1]] - times_s[shown[0]])
    moves = np.linalg.norm(travel) >= LEAST_TRAVEL_M
    headings = np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS
    poses = np.zeros((1 if moves else N_HEADINGS, len(skeleton.dof_names)))
    poses[:, 3] = np.arctan2(travel[1], travel[0]) if moves else headings
    poses[:, :3] = line[0] - joints(skeleton, poses).mean(axis=1)
    return poses[:, :N_ROOT]


def _activity_styles(model: MotionModel) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield each activity's mean coefficients (d,), with N_RATES frequencies, Hz, around those of its examples."""
    labels = np.array(model.activities)
    for activity in sorted(set(model.activities)):
        rates, alpha = model.cycle_rate_hz[labels == activity], model.scores[labels == activity].mean(axis=0)
        yield alpha, np.geomspace(rates.min() / SPEED_MARGIN, rates.max() * SPEED_MARGIN, N_RATES)


def _fine_enough(rates_hz: FloatArray, times_s: FloatArray) -> FloatArray:
    """Divide the range of frequencies so that neighbours end less than a table's phase apart."""
    low, high = rates_hz[[0, -1]]
    steps = int(np.ceil((high - low) * (times_s[-1] - times_s[0]) * N_PHASES))
    return rates_hz if steps < len(rates_hz) else np.linspace(low, high, steps + 1)
