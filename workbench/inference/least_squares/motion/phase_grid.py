"""Grid search for the initial phase and frequency of a cyclic motion in the first frames.

Paper D sets the phases of the first and last frame by hand. An initial phase off by 0.2 of a cycle leads to a wrong
minimum, so all phases are tried: a table of costs, frame by phase, with the root fitted in every cell. A motion of
constant frequency is a straight line in the table; the best lines are refined by least squares over all unknowns.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT
from workbench.core.prior import MotionModel
from workbench.inference.least_squares.motion.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.solver.single_frame import (
    LOSS_SCALE_FACTORS,
    FitData,
    PoseDecoder,
    fit_frame,
    fit_root,
)
from workbench.utils.arrays import FloatArray

N_FRAMES = 8
N_PHASES = 12
N_RATES = 8
N_REFINED = 4
TABLE_SCALE_FACTOR = 2.0
"""Factor of the loss's scale in the table, because its phases are discrete."""
SPEED_MARGIN = 1.25
"""Factor by which a motion may be slower or faster than the model's examples."""
_LINE_SUBDIVISION = 4  # initial phases of lines per phase of the table
_MIN_LINE_GAP = 0.1  # cycles, between refined lines


def find_phase(decoder: MotionDecoder, data: FitData, root: FloatArray) -> FloatArray:
    """Return states (F, D) of the first F ≤ N_FRAMES frames, each of which has observations. root: (6,) initial root in
    the first one, or several candidates (n, 6)."""
    data = data.select_frames(np.arange(len(data.times_s))[:N_FRAMES])
    frames, times_s = np.arange(len(data.times_s)), data.times_s
    lines: list[tuple[float, FloatArray]] = []
    tried = list(product(_activity_styles(decoder.model), np.atleast_2d(root)))
    for (alpha, rates_hz), guess in tqdm(tried, desc="phase", unit="grid", disable=None, leave=False):
        costs, roots = _phase_table(decoder, data, alpha, guess)
        for cost, phases in best_lines(costs, times_s, _dense_rates(rates_hz, times_s)):
            cells = np.round(phases * N_PHASES).astype(int) % N_PHASES
            lines.append((cost, decoder.states(alpha, phases, roots[frames, cells])))
    lines.sort(key=lambda line: line[0])
    problem = fit_problem(decoder, data, len(frames))
    refined = [fit_motion(problem, states, max_iterations=15, tolerance=1e-3) for _, states in lines[:N_REFINED]]
    return min(refined, key=lambda fit: fit[2].costs[-1])[0]


def _phase_table(
    decoder: MotionDecoder, data: FitData, alpha: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return costs (F, N_PHASES) and fitted roots (F, N_PHASES, 6) of every frame at phases 0, 1/N_PHASES, ….

    The root of a frame starts from that of the best phase in the previous frame; in the first one from the phase of
    lowest cost before the fit, with a widened loss.
    """
    costs, roots = np.empty((len(data.times_s), N_PHASES)), np.empty((len(data.times_s), N_PHASES, N_ROOT))
    poses = decoder.poses(decoder.states(alpha, np.arange(N_PHASES) / N_PHASES, root))
    free, wide, candidates = PoseDecoder(decoder.skeleton), data.loss.widened(TABLE_SCALE_FACTOR), list(poses)
    for t, residual in enumerate(data.residuals):
        poses[:, :N_ROOT] = fit_root(free, residual, data.loss, candidates, LOSS_SCALE_FACTORS[:1])
        for k, pose in enumerate(poses):
            fit = fit_frame(free, residual, wide, pose, free=np.arange(N_ROOT), max_iterations=6, tolerance=1e-2)
            costs[t, k], roots[t, k] = fit.costs[-1], fit.x[:N_ROOT]
        best = int(costs[t].argmin())
        poses[:, :N_ROOT] = roots[t, best]
        candidates = [poses[best]]
    return costs, roots


def best_lines(costs: FloatArray, times_s: FloatArray, rates_hz: FloatArray) -> list[tuple[float, FloatArray]]:
    """Return the N_REFINED best lines through a table (F, N), cost and phases (F,), cycles, of distinct phases."""
    frames, n_phases = np.arange(len(costs)), costs.shape[1]
    starts = np.arange(_LINE_SUBDIVISION * n_phases) / (_LINE_SUBDIVISION * n_phases)
    phases = starts[:, None, None] + rates_hz[:, None] * (times_s - times_s[0])  # (start, rate, frame)
    position = phases * n_phases
    lower, fraction = np.floor(position).astype(int), position - np.floor(position)
    sums = ((1.0 - fraction) * costs[frames, lower % n_phases] + fraction * costs[frames, (lower + 1) % n_phases]).sum(
        axis=-1
    )
    chosen: list[tuple[float, FloatArray]] = []
    for k in np.argsort(sums, axis=None, kind="stable"):
        line = phases[np.unravel_index(k, sums.shape)]
        if all(np.abs((line - other + 0.5) % 1.0 - 0.5).mean() > _MIN_LINE_GAP for _, other in chosen):
            chosen.append((float(sums.flat[k]), line))
        if len(chosen) == N_REFINED:
            break
    return chosen


def _activity_styles(model: MotionModel) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield each activity's mean coefficients (d,), with N_RATES frequencies, Hz, around those of its examples."""
    labels = np.array(model.activities)
    for activity in sorted(set(model.activities)):
        rates, alpha = model.cycle_rate_hz[labels == activity], model.scores[labels == activity].mean(axis=0)
        yield alpha, np.geomspace(rates.min() / SPEED_MARGIN, rates.max() * SPEED_MARGIN, N_RATES)


def _dense_rates(rates_hz: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return frequencies over the same range, so dense that neighbours end less than one phase of the table apart."""
    lower, high = rates_hz[[0, -1]]
    steps = int(np.ceil((high - lower) * (times_s[-1] - times_s[0]) * N_PHASES))
    return rates_hz if steps < len(rates_hz) else np.linspace(lower, high, steps + 1)
