"""Edges and ridges along the limbs (Sidenbladh & Black 2003): likelihood ratio of learned response distributions."""

import logging
import sys
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.simd_kinematics import FAST, inlined
from workbench.body.skeleton import without_side
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import POSITIVE, check
from workbench.core.frame import Frame, View
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.cues import edge_filters
from workbench.likelihoods.cues.edge_filters import ALONG, LOG_WIDTHS, MIN_LENGTH_PX, POINTS, FilteredBox, SmoothedView
from workbench.likelihoods.cues.limb_points import (
    PARTICLES,
    LimbFrameLikelihood,
    LimbPoints,
    LimbViewLikelihood,
    bounding_box,
    limb_points,
)
from workbench.motion.models.store import Provenance, cache_model, load
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for
from workbench.utils.source_hash import code_digest

log = logging.getLogger(__name__)

BINS = 32
_FIRST, _SECOND, _THIRD = np.arange(3)  # channels; numba would compile `_bilinear` for each Python number
EDGE_RANGE, RIDGE_RANGE = (0.0, 1.0), (-1.0, 1.0)  # of the responses; larger ones are in the last bin
OUTLIER_FRACTION = 0.05  # of uninformative responses
N_SCENES, N_FRAMES = 10, 5  # rendered people in the training set, and frames of each
UNLEARNED_LIMBS = ("neck", "foot")
"""Limbs that only some bodies have; the model is not trained on their edges, which are ignored."""
_FIRST_SEED = 1000  # of clothes, backgrounds and walks that no experiment uses
_N_DISPLACED = 8  # displaced poses per true pose


@dataclass(frozen=True, eq=False)
class EdgeModel:
    """Histograms of responses by limb. parts: names of G limbs, without left and right. on, off: counts (2, G, BINS),
    of edges and of ridges, at true poses and at displaced ones."""

    parts: tuple[str, ...]
    on: FloatArray
    off: FloatArray

    def log_ratio(self, limbs: Sequence[str]) -> Float32Array:
        """Return log p(response | on) − log p(response | off), (2, L, BINS), of limbs by name. Both distributions are
        mixed with a fraction OUTLIER_FRACTION of their common distribution, so that rare bins have ratios near 1. The
        log ratio of UNLEARNED_LIMBS is 0, with a warning. Raises InputError for another limb that the model does not
        have."""
        parts = [without_side(name) for name in limbs]
        unknown = sorted(set(parts) - set(self.parts))
        if unsupported := [part for part in unknown if part not in UNLEARNED_LIMBS]:
            raise InputError(f"edges: no limb {unsupported[0]!r} in the model; expected {', '.join(self.parts)}")
        if unknown:
            log.warning("edges: the model has no %s; their edges are ignored", " and ".join(unknown))
        count_tables = (self.on, self.off, self.on + self.off + 1.0)
        on, off, common = (counts / counts.sum(axis=-1, keepdims=True) for counts in count_tables)
        log_on, log_off = (np.log((1.0 - OUTLIER_FRACTION) * each + OUTLIER_FRACTION * common) for each in (on, off))
        ratio = log_on - log_off
        ratio = np.concatenate([ratio, np.zeros((2, 1, BINS))], axis=1)  # the last row is for unlearned limbs
        return ratio[:, [-1 if part in unknown else self.parts.index(part) for part in parts]].astype(np.float32)


def _edge_model(cache: str) -> EdgeModel:
    """Return the model of rendered people, from the folder `cache` or learned, which takes half a minute."""
    code = code_digest(sys.modules[__name__])
    provenance = Provenance({}, {"scenes": N_SCENES, "frames": N_FRAMES, "bins": BINS, "seed": _FIRST_SEED}, (), code)
    path = expanded(cache) / "models" / f"edges-{provenance.key[:16]}.h5"
    if path.is_file():
        return load(EdgeModel, path)
    log.info("learning edges and ridges from rendered people")
    rng = np.random.default_rng(_FIRST_SEED)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "synthetic: the person is", UserWarning)  # any height serves
        model = learn_edge_model(_rendered_people(rng), rng)
    return cache_model(path, model, provenance)


def _rendered_people(rng: np.random.Generator) -> Iterable[tuple[Body, View, FloatArray]]:
    """Yield views of walkers with varied appearance, with their bodies and true poses (P,)."""
    for scene in range(N_SCENES):
        dataset = Synthetic(
            path=("straight", "circle")[scene % 2], n_frames=N_FRAMES, rate_hz=4.0,
            view_azimuth_deg=float(rng.uniform(30.0, 150.0)), person_px=float(rng.uniform(200.0, 340.0)),
            contrast=float(rng.uniform(0.5, 1.5)), clutter=float(rng.uniform(0.5, 1.5)), seed=_FIRST_SEED + scene,
            perturb=False,  # limbs at their true places, like hand annotations
        )  # fmt: skip
        for frame in dataset.frames():
            if frame.truth is not None and frame.truth.pose is not None:
                yield dataset.body, frame.views[0], frame.truth.pose


def learn_edge_model(labelled_views: Iterable[tuple[Body, View, FloatArray]], rng: np.random.Generator) -> EdgeModel:
    """Return histograms of the responses at true poses (P,), and at poses displaced in the image by 5 to 60 cm."""
    counts: dict[str, FloatArray] = {}
    for body, view, pose in labelled_views:
        angle, distances = rng.uniform(0.0, 2.0 * np.pi, _N_DISPLACED), rng.uniform(0.05, 0.6, _N_DISPLACED)
        poses = np.repeat(pose[None], 1 + _N_DISPLACED, axis=0)
        right, down, _ = view.camera.rotation
        poses[1:, :3] += np.outer(distances * np.cos(angle), right) + np.outer(distances * np.sin(angle), down)
        points = limb_points(body, POINTS, view.camera, forward(body.skeleton, poses))
        images = edge_filters.filtered(edge_filters.smoothed(view), bounding_box(points))
        edges, ridges, valid = edge_filters.responses(images, points)
        filter_kinds = ((edges, valid[..., [0, 2]], EDGE_RANGE), (ridges, valid[..., 1], RIDGE_RANGE))
        for limb, name in enumerate(body.limbs.names):
            histogram = counts.setdefault(without_side(name), np.zeros((2, 2, BINS)))
            for kind, (values, counted, (low, high)) in enumerate(filter_kinds):
                for on, rows in enumerate((slice(0, 1), slice(1, None))):
                    inside = np.clip(values[rows, limb][counted[rows, limb]], low, np.nextafter(high, low))
                    histogram[on, kind] += np.histogram(inside, BINS, (low, high))[0]
    if not counts:
        raise InputError("edges: expected at least one view of a person for training, found none")
    on, off = np.stack(list(counts.values()), axis=2)
    return EdgeModel(tuple(counts), on, off)


@dataclass(frozen=True, eq=False)
class Edges:
    """Likelihood ratio of the filters' responses on a limb and elsewhere:

        log p = k/n Σ_j Σ_i log p_on(f_j,i) / p_off(f_j,i)

    f_j,i: the edge filters' responses at points on limb j's two sides, and the ridge filter's on its axis, n in all;
    points that are hidden or outside the image contribute 0. The distributions are histograms, per limb and filter, of
    rendered people in known poses. Each limb counts as k independent responses.

    Deviations from Sidenbladh & Black: the training images are rendered, not photographs; contrast is normalised by the
    local standard deviation; the ridge has only the scale of the limb's width; there are no temporal differences.
    Raises InputError if k ≤ 0, or the model lacks one of the body's limbs.

    Parameters
    ----------
    body : the person's body.
    effective_responses : k, per limb.
    cache : folder of the learned model.
    """

    traits: ClassVar[Traits] = component_traits(dataset=IMAGES)

    body: Body
    effective_responses: float = 1.0
    cache: str = "~/.cache/workbench"

    def __post_init__(self) -> None:
        check("edges", self, effective_responses=POSITIVE)

    @cached_property
    def log_ratio(self) -> Float32Array:
        """The log ratios of edges and ridges, for every limb of the body and bin of the response."""
        return _edge_model(self.cache).log_ratio(self.body.limbs.names)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        """Return the likelihood of a frame, whose views are smoothed and filtered later, around the limbs only."""
        views = [
            LimbViewLikelihood(view.camera, POINTS, partial(self._log_prob, SmoothedView(view))) for view in frame.views
        ]
        return LimbFrameLikelihood("edges", self.body, views, lambda expected_pose: self)

    def _log_prob(self, view: SmoothedView, points: LimbPoints) -> FloatArray:
        box = bounding_box(points)
        filtered = edge_filters.filtered(view.smoothed_around(box), box)
        return self.effective_responses * response_log_ratio(filtered, points, self.log_ratio).sum(axis=1)


def response_log_ratio(images: FilteredBox, points: LimbPoints, table: Float32Array) -> FloatArray:
    """Return the log ratios of all responses, summed for each limb (N, L), over n; table: (2, L, BINS)."""
    sums = np.empty(points.valid.shape[:2])
    arguments = (
        *(images.gradient, images.ridges, *images.corner),
        *(points.pixels, points.valid, table, LOG_WIDTHS, sums),
    )
    parallel_for(lambda first, last: _response_sums(first, last, *arguments), len(sums), PARTICLES)
    return sums / len(POINTS)


@kernel(error_model="numpy", fastmath=FAST)
def _response_sums(
    first_pose: int, last_pose: int, gradient: Any, ridges: Any, left: int, top: int,
    pixels: Any, valid: Any, table: Any, scales: Any, sums: Any,
) -> None:  # fmt: skip
    for i in range(first_pose, last_pose):
        for limb in range(valid.shape[1]):
            total, half_width = 0.0, 0.0
            for v in (0, 2, 1):
                first, last = v, 3 * (ALONG - 1) + v
                tx, ty = _direction(pixels, i, limb, first, last)
                length = np.sqrt(tx * tx + ty * ty)
                if not length > MIN_LENGTH_PX:
                    continue
                tx, ty = tx / length, ty / length
                if v == 1:
                    wx, wy = _direction(pixels, i, limb, 3 * (ALONG // 2), 3 * (ALONG // 2) + 2)
                    half_width = np.log(max(np.sqrt(wx * wx + wy * wy) / 2.0, 1e-9))
                    scale = _nearest(half_width, scales)
                for s in range(first, last + 1, 3):
                    if valid[i, limb, s]:
                        x, y = pixels[i, limb, s, 0], pixels[i, limb, s, 1]
                        if v == 1:
                            total += table[1, limb, _ridge_bin(ridges[scale], left, top, x, y, tx, ty)]
                        else:
                            total += table[0, limb, _edge_bin(gradient, left, top, x, y, tx, ty)]
            sums[i, limb] = total


@inlined
def _direction(pixels: Any, i: int, limb: int, first: int, last: int) -> tuple[float, float]:
    dx = np.float64(pixels[i, limb, last, 0]) - np.float64(pixels[i, limb, first, 0])
    return dx, np.float64(pixels[i, limb, last, 1]) - np.float64(pixels[i, limb, first, 1])


@inlined
def _nearest(value: float, values: Any) -> int:
    """Return the index of the first of the values nearest to a value."""
    nearest = 0
    for k in range(1, values.shape[0]):
        if abs(value - values[k]) < abs(value - values[nearest]):
            nearest = k
    return nearest


@inlined
def _edge_bin(gradient: Any, left: int, top: int, x: float, y: float, tx: float, ty: float) -> int:
    edge = abs(tx * _bilinear(gradient, left, top, x, y, _SECOND) - ty * _bilinear(gradient, left, top, x, y, _FIRST))
    return _bin(edge, EDGE_RANGE[0], EDGE_RANGE[1])


@inlined
def _ridge_bin(ridges: Any, left: int, top: int, x: float, y: float, tx: float, ty: float) -> int:
    xx, xy = _bilinear(ridges, left, top, x, y, _FIRST), _bilinear(ridges, left, top, x, y, _SECOND)
    yy = _bilinear(ridges, left, top, x, y, _THIRD)
    across = ty * ty * xx - 2.0 * tx * ty * xy + tx * tx * yy
    along = tx * tx * xx + 2.0 * tx * ty * xy + ty * ty * yy
    return _bin(abs(across) - abs(along), RIDGE_RANGE[0], RIDGE_RANGE[1])


@inlined
def _bin(value: float, low: float, high: float) -> int:
    return int(min(max((value - low) / (high - low) * BINS, 0.0), BINS - 1.0))


@inlined
def _bilinear(images: Any, left: int, top: int, x: float, y: float, k: Any) -> Any:
    """Return `limb_points.bilinear` of one of several images that are interleaved by pixel, in a box of the image."""
    column, row = np.uint32(x), np.uint32(y)
    fx, fy = np.float32(x - column), np.float32(y - row)
    column, row = np.uint32(column - left), np.uint32(row - top)
    right, below = np.uint32(column + np.uint32(1)), np.uint32(row + np.uint32(1))
    upper = images[row, column, k] + fx * (images[row, right, k] - images[row, column, k])
    lower = images[below, column, k] + fx * (images[below, right, k] - images[below, column, k])
    return upper + fy * (lower - upper)
