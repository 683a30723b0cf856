"""Agreement of several cameras about the joints they see: exchanged videos, and videos that are not synchronized."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.cameras.observed_joints import MIN_WEIGHT, ObservedJoints, some_frames
from workbench.cameras.time_offset import distance_curve
from workbench.cameras.triangulation import ray_directions, ray_distances, triangulate_normalized, undistorted
from workbench.utils.arrays import FloatArray
from workbench.utils.crossings import crossings
from workbench.utils.finding import NOT_USABLE, Finding
from workbench.utils.nan_statistics import nan_median

_MAX_SHIFT_S = 0.5
_SERIES_FRAMES = 500
"""Evenly spaced frames in which the start of a contradiction is searched for."""
_EXPLAINED = 0.7
"""Factor by which a shift or an exchange must reduce the distance between rays. It leaves the detector's error, so that
at 1/√2 the contradiction is as large as that error."""

_AGREEMENT_M = 0.075
"""Mean distance between the rays of cameras that agree: a forearm's width."""


def camera_findings(observed: ObservedJoints, explain: bool) -> Iterator[Finding]:
    """Yield cameras that are exchanged, not synchronized, or that contradict each other from some frame on.

    explain: the cameras contradict each other, so that exchanged videos are searched for.
    """
    rays = ray_directions(observed.cameras, undistorted(observed.cameras, observed.pixels(MIN_WEIGHT)))
    found = [*(_exchanged(observed, rays) if explain else ()), *_unsynchronized(observed, rays)]
    yield from found
    if not found:
        yield from _since(observed, skip_first=explain)


def _mean_distance(distances: FloatArray) -> float:
    valid = np.isfinite(distances)
    return float(np.mean(distances[valid])) if valid.any() else float("nan")


def _exchanged(observed: ObservedJoints, rays: FloatArray) -> Iterator[Finding]:
    """Find the two cameras whose exchange makes all cameras agree."""
    cameras, rows = observed.cameras, some_frames(rays.shape[1])
    pixels = observed.pixels(MIN_WEIGHT)[:, rows]

    def total(order: list[int]) -> float:
        own = ray_directions(cameras, undistorted(cameras, pixels[order]))
        pairs = combinations(zip(cameras, own, strict=True), 2)
        each = [_mean_distance(ray_distances(a, b, two.position - one.position)) for (one, a), (two, b) in pairs]
        return float(np.mean([value for value in each if np.isfinite(value)] or [np.inf]))

    order = list(range(len(cameras)))
    before = total(order)
    swaps = {(a, b): total([{a: b, b: a}.get(v, v) for v in order]) for a, b in combinations(order, 2)}
    (a, b), after = min(swaps.items(), key=lambda item: item[1])
    if after < _EXPLAINED * before:
        names = f"the videos of {cameras[a].name} and {cameras[b].name} are exchanged"
        message = f"{names}: rays miss each other by {_cm(before)}, and by {_cm(after)} the other way round"
        yield Finding("exchanged cameras", message, NOT_USABLE)


def _unsynchronized(observed: ObservedJoints, rays: FloatArray) -> Iterator[Finding]:
    """Find the camera whose shift in time by up to _MAX_SHIFT_S reduces the distances of its rays to the others'."""
    cameras, times_s = observed.cameras, observed.times_s
    if len(times_s) < 3 or (step_s := float(np.median(np.diff(times_s)))) <= 0.0:
        return
    n_frames = len(times_s)
    reach = min(int(_MAX_SHIFT_S / step_s), n_frames // 3)
    rows = np.arange(reach, n_frames - reach)[some_frames(n_frames - 2 * reach)]
    shifts = np.arange(-reach, reach + 1)  # frames by which the camera's rays are later than the others'
    shifts_s = np.asarray(-step_s * shifts, dtype=np.float64)
    by_camera: list[list[FloatArray]] = [[] for _ in cameras]
    for a, b in combinations(range(len(cameras)), 2):
        for v, other in ((a, b), (b, a)):
            baseline = cameras[v].position - cameras[other].position
            by_camera[v].append(distance_curve(
                rays[other, rows], times_s[rows], rays[v], times_s, baseline, shifts_s, _mean_distance
            ))  # fmt: skip
    means = np.array([np.mean(each, axis=0) for each in by_camera])  # (V, S)
    if not np.isfinite(means[:, reach]).all():
        return
    v, s = divmod(int(np.nanargmin(means / means[:, reach, None])), len(shifts))
    if 0 < abs(shifts[s]) < reach and means[v, s] < min(_EXPLAINED * means[v, reach], _AGREEMENT_M):
        late = "later" if shifts[s] > 0 else "earlier"
        which = f"{cameras[v].name} shows the person {abs(shifts[s]) * step_s:.2f} s {late} than the other cameras"
        distances = f"rays miss each other by {_cm(means[v, reach])}, and by {_cm(means[v, s])} with that shift"
        yield Finding("unsynchronized cameras", f"{which}: {distances}")


def _since(observed: ObservedJoints, skip_first: bool) -> Iterator[Finding]:
    """Yield the pairs of cameras that contradict each other, with the frame from which on they do."""
    texts, rows = [], some_frames(len(observed.times_s), _SERIES_FRAMES)
    times_s = observed.times_s[rows]
    for (first, second), separation in pair_separations(observed, rows).items():
        frames = crossings(separation, np.full(len(separation), FOREARM_OVER_HEIGHT))
        if not frames or (skip_first and frames[0] == 0):
            continue
        since = f" from {times_s[frames[0]]:.2f} s on" if frames[0] > 0 else ""
        by = f"by {np.nanmedian(separation[frames[0] :]):.0%} of the person's height{since}"
        texts.append(f"rays of {first} and {second} miss each other {by}")
    if texts:
        more = [f"and {len(texts) - 2} more pairs"] if len(texts) > 2 else []
        yield Finding("inconsistent cameras", ", ".join([*texts[:2], *more]))


def pair_separations(observed: ObservedJoints, rows: slice = slice(None)) -> dict[tuple[str, str], FloatArray]:
    """Return ray separations (F,) by pair of cameras, in the frames of `rows`.

    A separation is the median over joints of the mean reprojection error of both cameras from their common triangulated
    point, in heights of the person in the image. A point behind a camera counts as one height of the person.
    """
    pixels, heights = observed.pixels(MIN_WEIGHT)[:, rows], observed.heights_px.T[:, rows, None]
    heights = np.where(heights > 0.0, heights, np.nan)
    places, separations = undistorted(observed.cameras, pixels), {}
    for a, b in combinations(range(len(observed.cameras)), 2):
        points = triangulate_normalized([observed.cameras[v] for v in (a, b)], places[[a, b]])
        residuals = [
            np.linalg.norm(observed.cameras[v].project(points) - pixels[v], axis=-1) / heights[v] for v in (a, b)
        ]
        valid = np.isfinite(points[..., 0]) & np.isfinite(heights[[a, b]]).all(0)
        mean = np.where(valid, np.nan_to_num(np.mean(residuals, axis=0), nan=1.0), np.nan)
        series = nan_median(mean)
        if np.isfinite(series).any():
            separations[observed.cameras[a].name, observed.cameras[b].name] = series
    return separations


def _cm(length_m: float) -> str:
    return f"{100.0 * length_m:.1f} cm"
